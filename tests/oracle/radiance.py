"""The oracle of eq. (11): absolute spectral radiance along rays, in float64, without any of the kernels' code.

A ray is cut at every plane between cells of every box, and its segments in two until a part holds little optical depth
of the eye's way and of every lamp's, and until its light is that of its halves. A part is integrated by three Gauss
points, each lit through the exact optical depth of all boxes; only this outer integral is a quadrature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

import hagoromo as hg
from tests.oracle.lattice import Array, BoxFields, OracleVoxels
from tests.oracle.reflection import element_weights, gauss

NODES = 3  # of a part
NODE_SPAN = math.sqrt(0.6)  # from the first to the last of them, as a share of the part
UNSEEN = 30.0  # optical depth of the eye's way beyond which a part is left out: 1e-13
UNLIT = 1e-9  # share of the light of a lamp below which a part is not cut for that lamp
SCALE_RAYS = 5  # every so many rays are integrated roughly first, for the mean radiance
MOST_CUTS = 60  # times that a part may be cut in two
FINENESS = 0.5  # largest optical depth of a part, of the eye's way and of each lamp's
ACCURACY = 1e-4  # largest difference between a part and its halves, over the mean radiance


@dataclass
class Parts:
    """Parts of rays: number of the ray, near and far end [m], optical depth before it and in it."""

    ray: NDArray[np.intp]
    near: Array
    far: Array
    before: Array
    depth: Array

    def chosen(self, which: NDArray) -> Parts:
        """Some of the parts."""
        return Parts(self.ray[which], self.near[which], self.far[which], self.before[which], self.depth[which])


def radiance(
    boxes: Sequence[OracleVoxels],
    lamps: Sequence[hg.Lamp],
    rays: tuple[Array, Array],
    wavelengths: ArrayLike,
    accuracy: float = ACCURACY,
    fineness: float = FINENESS,
) -> tuple[Array, Array]:
    """L(o, v) of eq. (11) at wavelengths [nm]: (rays, wavelengths), and the transmittance (rays,).

    rays: origins [m] and directions, (rays, 3) each.
    accuracy, fineness: see ACCURACY, FINENESS; smaller ones cut rays into more parts.
    """
    return Oracle(boxes, lamps, rays, np.atleast_1d(np.asarray(wavelengths, float)), fineness).radiance(accuracy)


def camera_rays(camera: hg.Camera) -> tuple[Array, Array]:
    """Rays through the centres of the pixels, row by row, eq. (12): origins and unit directions (pixels, 3)."""
    y, x = np.mgrid[: camera.height, : camera.width].reshape(2, -1) + 0.5
    (ax, ay), (x0, y0) = camera.focal, camera.principal
    way = np.stack([(x - x0) / ax, (y - y0) / ay, np.ones_like(x)], axis=-1)
    turn, shift = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    way = way @ turn
    return np.broadcast_to(-turn.T @ shift, way.shape), way / np.linalg.norm(way, axis=1, keepdims=True)


class Oracle:
    """Boxes and lamps in float64, and rays through them."""

    def __init__(
        self,
        boxes: Sequence[OracleVoxels],
        lamps: Sequence[hg.Lamp],
        rays: tuple[Array, Array],
        wavelengths: Array,
        fineness: float,
    ) -> None:
        self.boxes, self.lamps = [BoxFields(voxels) for voxels in boxes], lamps
        self.wavelengths, self.fineness = wavelengths, fineness
        self.direction = rays[1] / np.linalg.norm(rays[1], axis=1, keepdims=True)
        self.origin = np.broadcast_to(rays[0], self.direction.shape)

    def radiance(self, accuracy: float) -> tuple[Array, Array]:
        """Radiance (rays, wavelengths) and transmittance (rays,)."""
        parts, transmittance = self.segments()
        some = parts.chosen(parts.ray % SCALE_RAYS == 0)
        rough = self.integrated(some, np.full(len(self.wavelengths), np.inf))
        scale = rough.sum(axis=0) / max(np.count_nonzero(rough.any(axis=1)), 1)
        return self.integrated(parts, accuracy * np.maximum(scale, 1e-30)), transmittance

    def integrated(self, parts: Parts, largest: Array) -> Array:
        """Light of the rays, (rays, wavelengths); largest: difference between a part and its halves that passes."""
        light = np.zeros((len(self.direction), len(self.wavelengths)))
        for _ in range(MOST_CUTS):
            parts = parts.chosen((parts.depth > 0.0) & (parts.before < UNSEEN))
            if len(parts.ray) == 0:
                return light
            halves = self.halves(parts)
            done = parts.depth <= self.fineness
            which = np.flatnonzero(done)
            whole, even, most = self.light(parts.chosen(which))
            bright = np.flatnonzero(most > largest.min())
            both, _, _ = self.light(halves.chosen(np.concatenate([which[bright], which[bright] + len(parts.ray)])))
            both = both[: len(bright)] + both[len(bright) :]
            even[bright] &= (np.abs(both - whole[bright]) <= largest).all(axis=1)
            whole[bright] = both
            np.add.at(light, parts.ray[which[even]], whole[even])
            done[which] = even
            parts = halves.chosen(np.tile(~done, 2))
        raise ArithmeticError(f"{len(parts.ray)} parts of rays are not fine enough after {MOST_CUTS} cuts")

    def segments(self) -> tuple[Parts, Array]:
        """The parts of rays between planes of cells, and the transmittance of each ray."""
        cuts = np.sort(np.concatenate([b.planes(self.origin, self.direction) for b in self.boxes], axis=1), axis=1)
        ray, place = np.nonzero(np.diff(cuts, axis=1) > 1e-12)
        near, far = cuts[ray, place], cuts[ray, place + 1]
        depth = self.eye_depth(ray, near, far)
        total = np.bincount(ray, depth, len(cuts))
        first = np.searchsorted(ray, ray)
        sums = np.concatenate([[0.0], np.cumsum(depth)])
        return Parts(ray, near, far, sums[:-1] - sums[first], depth), np.exp(-total)

    def halves(self, parts: Parts) -> Parts:
        """Every part as two."""
        middle = 0.5 * (parts.near + parts.far)
        first = self.eye_depth(parts.ray, parts.near, middle)
        second = self.eye_depth(parts.ray, middle, parts.far)
        return Parts(
            np.concatenate([parts.ray, parts.ray]),
            np.concatenate([parts.near, middle]),
            np.concatenate([middle, parts.far]),
            np.concatenate([parts.before, parts.before + first]),
            np.concatenate([first, second]),
        )

    def eye_depth(self, ray: NDArray[np.intp], near: Array, far: Array) -> Array:
        """Optical depth of parts that cross no plane of cells."""
        return sum((b.depth_between(self.origin[ray], self.direction[ray], near, far) for b in self.boxes), np.zeros(1))

    def light(self, parts: Parts) -> tuple[Array, NDArray[np.bool_], Array]:
        """Light of parts, (parts, wavelengths), whether they are fine enough for the way of every lamp, and how much
        light they would send if f were 1 /sr.
        """
        count = len(parts.ray)
        distance, weight = (v.ravel() for v in gauss(NODES, parts.near[:, None], parts.far[:, None]))
        ray, near = np.repeat(parts.ray, NODES), np.repeat(parts.near, NODES)
        before = np.repeat(parts.before, NODES) + self.eye_depth(ray, near, distance)
        point = self.origin[ray] + distance[:, None] * self.direction[ray]
        share = np.exp(-parts.before) * -np.expm1(-parts.depth)
        even, most, sent = np.ones(count, bool), np.zeros(count), np.zeros((len(ray), len(self.wavelengths)))
        for lamp in self.lamps:
            depth, irradiance, reflected = self.lit(lamp, point, -self.direction[ray])
            low, high = (end(depth.reshape(count, NODES), axis=1) for end in (np.min, np.max))
            change = (high - low) / NODE_SPAN
            brightest = np.exp(-np.maximum(0.5 * (low + high - change), 0.0))
            even &= (change <= self.fineness) | (share * brightest < UNLIT)
            most += share * brightest * irradiance.max(axis=1).reshape(count, NODES).max(axis=1)
            sent += np.exp(-depth)[:, None] * irradiance * reflected
        sent *= (weight * np.exp(-before))[:, None]
        return sent.reshape(count, NODES, len(self.wavelengths)).sum(axis=1), even, most

    def lit(self, lamp: hg.Lamp, point: Array, to_eye: Array) -> tuple[Array, Array, Array]:
        """Optical depth from points to a lamp; irradiance facing it without matter, and Σ σ f, per wavelength."""
        irradiance = np.full(len(point), np.asarray(lamp.intensity, float))
        if lamp.position is None:
            assert lamp.to_lamp is not None
            to_lamp = np.broadcast_to(lamp.to_lamp / np.linalg.norm(lamp.to_lamp), point.shape)
            distance = np.full(len(point), np.inf)
        else:
            distance = np.linalg.norm(lamp.position - point, axis=1)
            to_lamp = (lamp.position - point) / distance[:, None]
            irradiance /= distance**2
            if lamp.axis is not None:
                irradiance *= np.maximum(-to_lamp @ lamp.axis, 0.0) ** lamp.axis_power
        reflected = self.reflected(point, to_lamp, to_eye)
        seen = reflected.any(axis=1)
        depth = np.full(len(point), np.nan)
        depth[seen] = sum(box.depth_to(point[seen], to_lamp[seen], distance[seen]) for box in self.boxes)
        depth = np.where(seen, depth, _nearest(depth))
        return depth, irradiance[:, None] * at(lamp.spectrum, self.wavelengths), reflected

    def reflected(self, point: Array, to_lamp: Array, to_eye: Array) -> Array:
        """Σ over boxes of σ f(a; L, V) [1/m/sr]: (points, wavelengths)."""
        total = np.zeros((len(point), len(self.wavelengths)))
        for box in self.boxes:
            place = (point - box.offset) @ box.rotation / box.voxel + 0.5
            sigma = box.extinction(place, to_eye)
            held = np.flatnonzero(sigma > 0.0)
            numbers, axes, mixture = box.matter(place[held])
            for number, material in enumerate(box.materials):
                chosen = numbers == number
                here = held[chosen]
                body, interface = element_weights(material, axes[chosen], to_lamp[here], to_eye[here])
                colour = at(material.body_colour, self.wavelengths)
                if mixture is not None and box.basis:
                    colour = mixture[chosen] @ np.array([at(spectrum, self.wavelengths) for spectrum in box.basis])
                f = body[:, None] * colour + interface[:, None] * at(material.interface_colour, self.wavelengths)
                total[here] += sigma[here, None] * f
        return total


def at(spectrum: hg.Spectrum, wavelengths: Array) -> Array:
    """Linear between the values of a spectrum, 0 outside."""
    return np.interp(wavelengths, spectrum.wavelengths, spectrum.values, left=0.0, right=0.0)


def _nearest(depth: Array) -> Array:
    """For points that reflect nothing, whose depth was not computed: the least depth known in their part, or 0."""
    known = np.where(np.isnan(depth), np.inf, depth).reshape(-1, NODES).min(axis=1)
    return np.repeat(np.where(np.isfinite(known), known, 0.0), NODES)
