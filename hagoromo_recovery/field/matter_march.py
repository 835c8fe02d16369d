"""Matter march: light from a field of matter along rays, and its adjoint. Surface and fuzzy matter are its two laws.

A law says how opaque a piece of a ray is between the values of the field at both ends, where in it its light comes
from, and how much of the lamps' light arrives there: `SurfaceMarch` by a signed distance, `FuzzyMarch` by a density.

The adjoint takes the same pieces once more, and lets Dr.Jit differentiate one piece at a time: what is behind it is
known from the first pass (path replay, Vicini et al. 2021).
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays
from hagoromo_recovery.field.matter_field import COLOURS, MatterField

LEAST_DEPTH = 1e-3  # optical depth of a piece that counts
LAST_DEPTH = 7.0  # optical depth at which a ray ends


class LatticeRays(NamedTuple):
    """origin: Array3f, lattice. direction: unit. near, far: Float [voxel]."""

    origin: Array3f
    direction: Array3f
    near: Float
    far: Float

    def at(self, way: Float) -> Array3f:
        """The place that is so far along each ray [voxel]."""
        return dr.fma(self.direction, way, self.origin)


class Seen(NamedTuple):
    """light: of every lamp and colour. depth: optical depth of the ray. way: mean distance [voxel]."""

    light: list[Float]
    depth: Float
    way: Float


class Piece(NamedTuple):
    """A piece of rays. begin, length [voxel]; first, second: values of the field at its ends."""

    begin: Float
    length: Float
    first: Float
    second: Float


class MatterMarch(ABC):
    """field: what rays meet. shading: see `NodeShading`."""

    lights_pieces = False  # whether `arriving` has the shadows; if not, they are those of the mean place of a ray

    def __init__(self, field: MatterField, shading: Any) -> None:
        self.field, self.shading = field, shading

    @property
    def least_depth(self) -> float:
        """Optical depth of a piece that counts."""
        return LEAST_DEPTH

    @abstractmethod
    def step_length(self, value: Float, place: Array3f) -> Float:
        """How far a ray may go from a place where the field has this value [voxel]. It has no derivative."""

    @abstractmethod
    def depth_of(self, piece: Piece) -> Float:
        """Optical depth of a piece."""

    @abstractmethod
    def share_of(self, piece: Piece) -> Float:
        """Where in a piece its light comes from on the mean, 0 at its begin to 1."""

    def arriving(self, place: Array3f) -> list[Float] | None:
        """Share of each lamp's light that arrives at a place; None: all of it, here."""
        return None

    def add_by_arriving(self, place: Array3f, by_logarithm: list[Float]) -> None:
        """Add the gradient of Σ by_logarithm · ln(share of each lamp's light that arrives)."""
        return

    def place(self, rays: LatticeRays, piece: Piece) -> Array3f:
        """Where the light of a piece comes from on the mean."""
        return rays.at(dr.fma(self.share_of(piece), piece.length, piece.begin))

    def light(
        self, rays: LatticeRays, place: Array3f, axis: Array3f, looks: list[Float], arriving: list[Float] | None
    ) -> list[Float]:
        """Light of every lamp and colour that matter of this axis and these looks sends back along a ray."""
        unit = axis * dr.rsqrt(dr.fmax(dr.squared_norm(axis), 1e-12))
        light = self.shading(place, unit, -rays.direction, looks)
        if arriving is None:
            return light
        each = len(light) // len(arriving)
        return [arriving[k // each] * one for k, one in enumerate(light)]

    @dr.syntax
    def seen(self, rays: LatticeRays) -> Seen:
        """What rays see; without shadows, where `arriving` has none."""
        jit, count = arrays(), dr.width(rays.direction)
        light = [dr.zeros(jit.Float, count) for _ in range(self.shading.channels)]
        depth, way, weights = dr.zeros(jit.Float, count), dr.zeros(jit.Float, count), dr.zeros(jit.Float, count)
        t = dr.copy(rays.near) + dr.zeros(jit.Float, count)
        first = self.field.value_at(rays.at(t))
        while (t < rays.far) & (depth < LAST_DEPTH):
            length = dr.fmin(self.step_length(first, rays.at(t)), rays.far - t)
            second = self.field.value_at(rays.at(t + length))
            piece = Piece(t, length, first, second)
            own = self.depth_of(piece)
            if own > self.least_depth:
                weight = dr.exp(-depth) * (1.0 - dr.exp(-own))
                place = self.place(rays, piece)
                matter = self.field.axis_at(place), self.field.looks_at(place)
                light = added(light, weight, self.light(rays, place, matter[0], matter[1], self.arriving(place)))
                way = dr.fma(weight, dr.fma(self.share_of(piece), length, t), way)
                weights += weight
                depth += own
            t += dr.fmax(length, 1e-3)
            first = second
        return Seen(light, depth, way / dr.fmax(weights, 1e-6))

    @dr.syntax
    def transmittance(self, rays: LatticeRays) -> Float:
        """Share of light that passes along rays."""
        jit, count = arrays(), dr.width(rays.direction)
        depth = dr.zeros(jit.Float, count)
        t = dr.copy(rays.near) + dr.zeros(jit.Float, count)
        first = self.field.value_at(rays.at(t))
        while (t < rays.far) & (depth < LAST_DEPTH):
            length = dr.fmin(self.step_length(first, rays.at(t)), rays.far - t)
            second = self.field.value_at(rays.at(t + length))
            depth += self.depth_of(Piece(t, length, first, second))
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
        first = self.field.value_at(rays.at(t))
        carried = dr.zeros(jit.Float, count)  # derivative by `first`, of the piece in front
        while (t < rays.far) & (depth < LAST_DEPTH):
            length = dr.fmin(self.step_length(first, rays.at(t)), rays.far - t)
            second = self.field.value_at(rays.at(t + length))
            piece = Piece(t, length, first, second)
            own = self.depth_of(piece)
            before, carried = carried, dr.zeros(jit.Float, count)
            if own > self.least_depth:
                rest, by_first, by_second = self._differentiated(rays, piece, (depth, own), rest, by_light, by_depth)
                before += by_first
                carried = by_second
                depth += own
            if before != 0.0:
                self.field.add_by_value(rays.at(t), before)
            t += dr.fmax(length, 1e-3)
            first = second
        self.field.add_by_value(rays.at(t), carried)

    def _differentiated(
        self,
        rays: LatticeRays,
        piece: Piece,
        depths: tuple[Float, Float],
        rest: list[Float],
        by_light: list[Float],
        by_depth: Float,
    ) -> tuple[list[Float], Float, Float]:
        """Adds the gradient of one piece by axis and looks.

        depths: in front of the piece, and its own. Returns the light from behind it, and the derivatives by the values
        at its ends.
        """
        depth, own = depths
        passed = dr.exp(-depth)
        weight = passed * (1.0 - dr.exp(-own))
        arriving = self.arriving(self.place(rays, piece))
        with dr.resume_grad():
            first, second = dr.detach(piece.first), dr.detach(piece.second)
            dr.enable_grad(first, second)
            ends = piece._replace(first=first, second=second)
            grown = self.depth_of(ends)
            place = self.place(rays, ends)
            matter = self.field.axis_at(place), self.field.looks_at(place)
            axis, looks = dr.detach(matter[0]), [dr.detach(each) for each in matter[1]]
            here = dr.detach(place)
            dr.enable_grad(axis, looks, here)
            new = self.light(rays, here, axis, looks, arriving)
            rest = added(rest, -weight, [dr.detach(each) for each in new])
            total, by_piece = arrays().Float(0), by_depth
            for by, light, behind in zip(by_light, new, rest, strict=True):
                total += (by * weight) * light
                by_piece = by_piece + by * (passed * dr.exp(-own) * dr.detach(light) - behind)
            dr.backward(total)
            by_axis, by_looks, by_place = dr.grad(axis), [dr.grad(each) for each in looks], dr.grad(here)
            onwards = dr.dot(by_axis, matter[0]) + dr.dot(by_place, place) + by_piece * grown
            for by, each in zip(by_looks, matter[1], strict=True):
                onwards += by * each
            dr.backward(onwards)
            by_first, by_second = dr.grad(first), dr.grad(second)
        self.field.add_by_axis(here, by_axis)
        self.field.add_by_colours(here, by_looks[:COLOURS])
        if arriving is not None:
            parts, each = [by * weight * dr.detach(one) for by, one in zip(by_light, new, strict=True)], 0
            each = len(parts) // len(arriving)
            self.add_by_arriving(here, [sum(parts[k * each : (k + 1) * each]) for k in range(len(arriving))])
        return rest, by_first, by_second


def added(light: list[Float], weight: Float, new: list[Float]) -> list[Float]:
    """light + weight · new."""
    return [dr.fma(weight, b, a) for a, b in zip(light, new, strict=True)]
