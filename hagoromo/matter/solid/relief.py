"""Relief: a surface seen from one side → volume boxes, a thin opaque skin of particles with the measured reflectance.

Particles in a skin shade each other: with the light attenuated on its way in and out, an opaque skin of particles
that reflect f shows f cosθ_i / (cosθ_i + cosθ_r) (Lommel 1889, Seeliger 1887). Two kinds of particle in equal parts
undo this: plane ones of 2 α cosθ_i and round ones, which show all lamps alike, of 2 α cosθ_r: α cosθ_i in sum. The
interface is with the plane ones, 4 β of it, which is right where θ_i = θ_r: in the middle of a highlight.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.field_blocks import FieldBlocks
from hagoromo.volume.header import BoxHeader
from hagoromo.volume.plan import BoxPlan

EDGE = 3.0  # voxels from outside to full density, measured along the normal
SKIN = 6.0  # voxels of matter along the normal
DEPTH = 9.0  # optical depth of the skin: 1e-4 passes, and the mean free path is longer than a step of the march
STEEPEST = 0.3  # least cosine to the line of sight for thickness: a steeper skin would be deeper than the object
SHARPEST = 0.5  # the same for the edge: of a steeper skin it would reach far towards the eye, and throw shadows
RIM = 3  # px along the outline, into which what is beside the surface is mixed: by the edge, demosaicing, resampling
SPIKE = 3.0  # voxels by which a single pixel may stand out towards the eye: spikes of the rim would throw shadows
MARGIN = 4  # voxels around the surface
PARTICLES = ("plane", "round")


@dataclass(frozen=True, eq=False)
class Relief:
    """A measured surface: points (h, w, 3) [m], world, 0 where unknown; normals (h, w, 3) unit; body (h, w, j) α c_b
    per pixel on a basis of j spectra; labels (h, w) of its materials, −1 unknown.
    """

    points: NDArray[np.floating]
    normals: NDArray[np.floating]
    body: NDArray[np.floating]
    labels: NDArray[np.integer]

    def known(self) -> NDArray[np.bool_]:
        """(h, w) pixels with point, normal and label, but for RIM along the outline; `InputError` if there is none."""
        from scipy.ndimage import binary_erosion, binary_fill_holes

        known = (np.linalg.norm(self.points, axis=2) > 0) & (np.linalg.norm(self.normals, axis=2) > 0.5)
        known &= self.labels >= 0
        known &= np.asarray(binary_erosion(binary_fill_holes(known), iterations=RIM, border_value=1))
        if not known.any():
            raise InputError("the relief has no pixel with point, normal and label: there is nothing to fill")
        return np.asarray(known, np.bool_)


@dataclass(frozen=True)
class Skin:
    """One half of a relief's skin: particles, plane or round. phase: angle between lamp and eye [rad] for which the
    round ones are right.
    """

    particles: Literal["plane", "round"]
    phase: float

    def material(self, material: Reflectance) -> Reflectance:
        """The reflectance of a particle where the surface's is `material`."""
        if self.particles == "plane":
            return replace(material, alpha=2.0 * material.alpha, beta=4.0 * material.beta, element="plane")
        # closed form of the sphere element, MODEL §2
        share = 2.0 / (3.0 * math.pi) * (math.sin(self.phase) + (math.pi - self.phase) * math.cos(self.phase))
        return replace(material, alpha=2.0 * material.alpha / share, beta=0.0, element="sphere")


def relief_boxes(
    relief: Relief, camera: Camera, materials: Sequence[Reflectance], phase: float, name: str = "relief"
) -> tuple[VolumeBox, VolumeBox]:
    """Both halves of the skin of `relief`, with `body` on `smooth_rgb_basis`; see `relief_plan`."""
    plane, round_ = (
        relief_plan(relief, camera, materials, Skin(particles, phase)).named(f"{name}, {particles}", {}).box()
        for particles in PARTICLES
    )
    return plane, round_


def relief_plan(
    relief: Relief,
    camera: Camera,
    materials: Sequence[Reflectance],
    skin: Skin,
    basis: Sequence[Spectrum] | None = None,
) -> BoxPlan:
    """The box of one half of the skin of `relief`, as `camera` saw it; two in one place show it.

    The box lies along the camera's axes (x right, y down, z away), with voxels of one pixel at the mean depth.
    materials: by label, of the surface; the body colour of a voxel is that of its pixel, on `basis` (default
    `smooth_rgb_basis`), over α. `InputError` when nothing is known, the lens is distorted, or the particles, twice as
    bright as the surface or more, break energy conservation (dim α and β, and light the box by stronger lamps).
    """
    if any(camera.distortion):
        raise InputError("a relief needs photographs without lens distortion: undistort them first")
    known = relief.known()
    rows, columns = np.nonzero(known)
    pose = camera.world_to_camera[:3]
    local = relief.points[rows, columns].astype(np.float64) @ pose[:, :3].T + pose[:, 3]
    if local[:, 2].min() <= 0.0:
        raise InputError("the relief has points behind the camera: give the camera that saw it")
    voxel = float(local[:, 2].mean() / np.mean(camera.focal))
    around = _median_around(known, local[:, 2])
    local *= np.where(local[:, 2] < around - SPIKE * voxel, around / local[:, 2], 1.0)[:, None]
    behind = local * (1.0 + SKIN / STEEPEST * voxel / local[:, 2:])  # where the skin of a steep pixel may end
    low = np.minimum(local, behind).min(axis=0) - MARGIN * voxel
    high = np.maximum(local, behind).max(axis=0) + MARGIN * voxel
    low[2] = max(low[2], 0.5 * local[:, 2].min())
    low[:2] = (
        np.floor(low[:2] / voxel + camera.principal) - camera.principal
    ) * voxel  # a voxel has the colour of one pixel
    to_world = camera.camera_to_world.copy()
    to_world[:3, 3] += to_world[:3, :3] @ low
    facing = relief.normals @ pose[:, :3].T
    alphas = np.array([material.alpha for material in materials])
    colour = relief.body / alphas[np.maximum(relief.labels, 0)][..., None]
    if skin.particles == "round":
        cosine = np.zeros(known.shape)
        cosine[known] = -np.einsum("pi,pi->p", facing[known], local / np.linalg.norm(local, axis=1, keepdims=True))
        colour = colour * np.maximum(cosine, 0.0)[..., None]
    places = np.zeros((*known.shape, 3))
    places[known] = local - low
    field = _Field(known, places, facing, colour, relief.labels, camera, low, voxel)
    shape = tuple(int(count) for count in np.ceil((high - low) / voxel))
    header = BoxHeader(
        voxel,
        0.5 * DEPTH / (SKIN * voxel),
        tuple(skin.material(material) for material in materials),
        to_world,
        tuple(smooth_rgb_basis() if basis is None else basis),
        f"relief, {skin.particles}",
    )
    return BoxPlan(header, FieldBlocks(field, (shape[2], shape[1], shape[0]), voxel))


def _median_around(known: NDArray[np.bool_], depth: NDArray[np.float64]) -> NDArray[np.float64]:
    """(n,) median of the depths (n,) of the known pixels around each, within two pixels."""
    from numpy.lib.stride_tricks import sliding_window_view

    image = np.full((known.shape[0] + 4, known.shape[1] + 4), np.nan)
    image[2:-2, 2:-2][known] = depth
    return np.nanmedian(sliding_window_view(image, (5, 5))[known].reshape(-1, 25), axis=1)


class _Field:
    """Density, axis, material and body colour at box coordinates [m], from images of the surface on the device."""

    def __init__(
        self,
        known: NDArray[np.bool_],
        places: NDArray[np.float64],
        facing: NDArray[np.float64],
        colour: NDArray[np.float64],
        labels: NDArray[np.integer],
        camera: Camera,
        low: NDArray[np.float64],
        voxel: float,
    ) -> None:
        rows, columns = np.nonzero(known)
        self.first = int(columns.min()), int(rows.min())
        crop = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        self.rows, self.columns = known[crop].shape
        self.voxel, self.low, self.camera = float(voxel), low.tolist(), camera
        kinds = arrays()

        def images(values: NDArray) -> list[Any]:
            return [kinds.Float(values[crop][..., i].astype(np.float32).ravel()) for i in range(values.shape[2])]

        (self.known,) = images(known[..., None])
        self.place, self.facing, self.colour = images(places), images(facing), images(colour)
        self.labels = kinds.UInt(np.maximum(labels[crop], 0).astype(np.uint32).ravel())

    def __call__(self, p: Any) -> tuple[Any, Any, Any, list[Any]]:
        kinds = arrays()
        (ax, ay), (x0, y0) = self.camera.focal, self.camera.principal
        away = p.z + self.low[2]
        column = (p.x + self.low[0]) / away * ax + (x0 - self.first[0])
        row = (p.y + self.low[1]) / away * ay + (y0 - self.first[1])
        inside = (column >= 0.0) & (row >= 0.0) & (column < self.columns) & (row < self.rows)
        at = kinds.UInt(clip(row, 0.0, self.rows - 1.0)) * self.columns
        at += kinds.UInt(clip(column, 0.0, self.columns - 1.0))
        inside &= dr.gather(kinds.Float, self.known, at) > 0.5
        axis = kinds.Array3f(*(dr.gather(kinds.Float, part, at) for part in self.facing))
        place = kinds.Array3f(*(dr.gather(kinds.Float, part, at) for part in self.place))
        # distance below the plane of the pixel's facet: along its line of sight, no steeper than STEEPEST, and aside
        ray = (place + kinds.Array3f(*self.low)) / (place.z + self.low[2])
        deeper = p.z - place.z
        aside = p - place - ray * deeper
        cosine, aside = -dr.dot(axis, ray), dr.dot(axis, aside)
        above, below = ((deeper * dr.fmax(cosine, least) - aside) / self.voxel for least in (SHARPEST, STEEPEST))
        density = _rising(above / EDGE + 0.5) * _rising((SKIN + 0.5 * EDGE - below) / EDGE)
        colours = [dr.gather(kinds.Float, part, at) for part in self.colour]
        return dr.select(inside, density, 0.0), axis, dr.gather(kinds.UInt, self.labels, at), colours


def _rising(t: Any) -> Any:
    """0 below 0, 1 above 1, a smooth cubic between."""
    t = clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
