"""Surface march: light from a signed distance along rays, and its adjoint.

Opacity is that of elements that face the ray: σ = (1/s) (1 − Φ(d/s)) max(0, −∇d·v), Φ the logistic function of
width s. Along a piece of a ray in which d falls from d₀ to d₁ its optical depth is ln Φ(d₀/s) − ln Φ(d₁/s), whatever
lies between (Wang et al. 2021, NeuS); where d rises nothing is in the way, so light that leaves a surface, to a lamp
or to the eye, is not shaded by the skin that it comes from.

The adjoint takes the same pieces once more, and lets Dr.Jit differentiate one piece at a time: what is behind it is
known from the first pass (path replay, Vicini et al. 2021).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays, clip
from hagoromo.recovery.distance_field import DistanceField

FAR = 6.0  # of s: beyond this distance nothing is opaque
LEAST_STEP, LARGEST_STEP = 1.4, 64.0  # [voxel]
STEP_SHARE = 0.9  # of the distance, that a step goes: the distance is not exact
LEAST_DEPTH = 1e-3  # optical depth of a piece that counts
LAST_DEPTH = 7.0  # optical depth at which a ray ends


class LatticeRays(NamedTuple):
    """origin: Array3f, lattice. direction: unit. near, far: Float [voxel]."""

    origin: Array3f
    direction: Array3f
    near: Float
    far: Float


class Seen(NamedTuple):
    """light: of every lamp and colour, without shadows. depth: optical depth of the ray. way: mean distance [voxel]."""

    light: list[Float]
    depth: Float
    way: Float


def softplus(x: Float) -> Float:
    """ln(1 + exp x)."""
    return dr.fmax(x, 0.0) + dr.log(1.0 + dr.exp(-dr.abs(x)))


def depth_between(first: Float, second: Float, inverse: Float) -> Float:
    """Optical depth of a piece between two distances [voxel]; inverse: 1/s."""
    return dr.fmax(softplus(-second * inverse) - softplus(-first * inverse), 0.0)


def sigmoid(x: Float) -> Float:
    """Φ(x)."""
    return dr.rcp(1.0 + dr.exp(-x))


def share_of(first: Float, second: Float, inverse: Float) -> Float:
    """Where in a piece its light comes from on the mean, 0 at its begin to 1: d is taken to be linear in it.

    The light of a place of distance u has the weight Φ'(u/s), the logistic density: its mean is closed.
    """
    a, b = first * inverse, second * inverse

    def moment(x: Float) -> Float:
        return x * sigmoid(x) - softplus(x)

    total = sigmoid(a) - sigmoid(b)
    safe = dr.fmax(total, 1e-6)
    mean = dr.select(total > 1e-5, (moment(a) - moment(b)) / safe, 0.5 * (a + b))
    return clip((a - mean) / dr.fmax(a - b, 1e-6), 0.0, 1.0)


def step_length(distance: Float, inverse: Float) -> Float:
    """How far a ray may go from a place of this distance [voxel]."""
    free = STEP_SHARE * (dr.abs(distance) - FAR / inverse)
    return clip(free, LEAST_STEP, LARGEST_STEP)


class SurfaceMarch:
    """field: what rays meet. inverse: 1/s [1/voxel], Float. shading: see `SurfaceShading`."""

    def __init__(self, field: DistanceField, inverse: Float, shading: Any) -> None:
        self.field, self.inverse, self.shading = field, inverse, shading

    def piece(self, rays: LatticeRays, begin: Float, length: Float, first: Float, second: Float) -> list[Float]:
        """Light of every lamp and colour of a piece, per unit of its opacity."""
        place = self.place(rays, begin, length, first, second)
        return self.light(rays, place, self.field.slope_at(place), self.field.colours_at(place))

    def place(self, rays: LatticeRays, begin: Float, length: Float, first: Float, second: Float) -> Array3f:
        """Where the light of a piece comes from on the mean."""
        return dr.fma(rays.direction, dr.fma(share_of(first, second, self.inverse), length, begin), rays.origin)

    def light(self, rays: LatticeRays, place: Array3f, slope: Array3f, colours: list[Float]) -> list[Float]:
        """Light of every lamp and colour that matter of this slope and these colours sends back along a ray."""
        normal = slope * dr.rsqrt(dr.fmax(dr.squared_norm(slope), 1e-12))
        return self.shading(place, normal, -rays.direction, colours)

    @dr.syntax
    def seen(self, rays: LatticeRays) -> Seen:
        """What rays see, without shadows."""
        jit, count = arrays(), dr.width(rays.direction)
        light = [dr.zeros(jit.Float, count) for _ in range(self.shading.channels)]
        depth, way, weights = dr.zeros(jit.Float, count), dr.zeros(jit.Float, count), dr.zeros(jit.Float, count)
        t = dr.copy(rays.near) + dr.zeros(jit.Float, count)
        first = self.field.distance_at(dr.fma(rays.direction, t, rays.origin))
        while (t < rays.far) & (depth < LAST_DEPTH):
            length = dr.fmin(step_length(first, self.inverse), rays.far - t)
            second = self.field.distance_at(dr.fma(rays.direction, t + length, rays.origin))
            piece = depth_between(first, second, self.inverse)
            if piece > LEAST_DEPTH:
                weight = dr.exp(-depth) * (1.0 - dr.exp(-piece))
                light = added(light, weight, self.piece(rays, t, length, first, second))
                way = dr.fma(weight, dr.fma(share_of(first, second, self.inverse), length, t), way)
                weights += weight
                depth += piece
            t += dr.fmax(length, 1e-3)
            first = second
        return Seen(light, depth, way / dr.fmax(weights, 1e-6))

    @dr.syntax
    def transmittance(self, rays: LatticeRays) -> Float:
        """Share of light that passes along rays."""
        jit, count = arrays(), dr.width(rays.direction)
        depth = dr.zeros(jit.Float, count)
        t = dr.copy(rays.near) + dr.zeros(jit.Float, count)
        first = self.field.distance_at(dr.fma(rays.direction, t, rays.origin))
        while (t < rays.far) & (depth < LAST_DEPTH):
            length = dr.fmin(step_length(first, self.inverse), rays.far - t)
            second = self.field.distance_at(dr.fma(rays.direction, t + length, rays.origin))
            depth += depth_between(first, second, self.inverse)
            t += dr.fmax(length, 1e-3)
            first = second
        return dr.exp(-depth)

    @dr.syntax
    def adjoint(self, rays: LatticeRays, seen: Seen, by_light: list[Float], by_depth: Float) -> None:
        """Adds to the gradients of the nodes and of the shading: those of Σ by_light · light + by_depth · depth.

        by_light: derivative of the loss by the light of every lamp and colour; by_depth: by the optical depth itself.
        """
        jit, count = arrays(), dr.width(rays.direction)
        rest = [dr.copy(each) for each in seen.light]
        depth = dr.zeros(jit.Float, count)
        t = dr.copy(rays.near) + dr.zeros(jit.Float, count)
        first = self.field.distance_at(dr.fma(rays.direction, t, rays.origin))
        carried = dr.zeros(jit.Float, count)  # derivative by `first`, of the piece in front
        while (t < rays.far) & (depth < LAST_DEPTH):
            length = dr.fmin(step_length(first, self.inverse), rays.far - t)
            second = self.field.distance_at(dr.fma(rays.direction, t + length, rays.origin))
            piece = depth_between(first, second, self.inverse)
            before, carried = carried, dr.zeros(jit.Float, count)
            if piece > LEAST_DEPTH:
                rest, by_first, by_second = self._differentiated(
                    rays, (t, length), (first, second), (depth, piece), rest, by_light, by_depth
                )
                before += by_first
                carried = by_second
                depth += piece
            if before != 0.0:
                self.field.add_by_distance(dr.fma(rays.direction, t, rays.origin), before)
            t += dr.fmax(length, 1e-3)
            first = second
        self.field.add_by_distance(dr.fma(rays.direction, t, rays.origin), carried)

    def _differentiated(
        self,
        rays: LatticeRays,
        interval: tuple[Float, Float],
        ends: tuple[Float, Float],
        depths: tuple[Float, Float],
        rest: list[Float],
        by_light: list[Float],
        by_depth: Float,
    ) -> tuple[list[Float], Float, Float]:
        """Adds the gradient of one piece by slope, colours and shading.

        interval: begin and length. ends: distances there. depths: in front of the piece, and its own. Returns the light
        from behind it, and the derivatives by the distances at its ends.
        """
        (t, length), (depth, piece) = interval, depths
        passed = dr.exp(-depth)
        weight = passed * (1.0 - dr.exp(-piece))
        with dr.resume_grad():
            first, second = dr.detach(ends[0]), dr.detach(ends[1])
            dr.enable_grad(first, second)
            grown = depth_between(first, second, self.inverse)
            place = self.place(rays, t, length, first, second)
            matter = self.field.slope_at(place), self.field.colours_at(place)
            slope, colours = dr.detach(matter[0]), [dr.detach(each) for each in matter[1]]
            here = dr.detach(place)
            dr.enable_grad(slope, colours, here)
            new = self.light(rays, here, slope, colours)
            rest = added(rest, -weight, [dr.detach(each) for each in new])
            total, by_piece = arrays().Float(0), by_depth
            for by, own, behind in zip(by_light, new, rest, strict=True):
                total += (by * weight) * own
                by_piece = by_piece + by * (passed * dr.exp(-piece) * dr.detach(own) - behind)
            dr.backward(total)
            by_slope, by_colours, by_place = dr.grad(slope), [dr.grad(each) for each in colours], dr.grad(here)
            onwards = dr.dot(by_slope, matter[0]) + dr.dot(by_place, place) + by_piece * grown
            for by, each in zip(by_colours, matter[1], strict=True):
                onwards += by * each
            dr.backward(onwards)
            by_first, by_second = dr.grad(first), dr.grad(second)
        self.field.add_by_slope(here, by_slope)
        self.field.add_by_colours(here, by_colours)
        return rest, by_first, by_second


def added(light: list[Float], weight: Float, new: list[Float]) -> list[Float]:
    """light + weight · new."""
    return [dr.fma(weight, b, a) for a, b in zip(light, new, strict=True)]
