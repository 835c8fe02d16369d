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
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.matter.solid.relief_field import SKIN, STEEPEST, Lattice, ReliefField
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.field_blocks import FieldBlocks
from hagoromo.volume.header import BoxHeader
from hagoromo.volume.plan import BoxPlan

DEPTH = 9.0  # optical depth of the skin: 1e-4 passes, and the mean free path is longer than a step of the march
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
    local = _without_spikes(known, local, voxel)
    behind = local * (1.0 + SKIN / STEEPEST * voxel / local[:, 2:])  # where the skin of a steep pixel may end
    low = np.minimum(local, behind).min(axis=0) - MARGIN * voxel
    high = np.maximum(local, behind).max(axis=0) + MARGIN * voxel
    low[2] = max(low[2], 0.5 * local[:, 2].min())
    # a voxel has the colour of one pixel: their centres coincide at the mean depth
    low[:2] = (np.floor(low[:2] / voxel + camera.principal) - camera.principal) * voxel
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
    field = ReliefField(known, places, facing, colour, relief.labels, Lattice(camera, low, voxel))
    shape = tuple(int(count) for count in np.ceil((high - low) / voxel))
    header = BoxHeader(
        voxel,
        0.5 * DEPTH / (SKIN * voxel),
        tuple(skin.material(material) for material in materials),
        to_world,
        tuple(smooth_rgb_basis() if basis is None else basis),
        f"relief, {skin.particles}",
    )
    return BoxPlan(header, FieldBlocks(field, (shape[2], shape[1], shape[0]), voxel, field.occupied))


def _without_spikes(known: NDArray[np.bool_], local: NDArray[np.float64], voxel: float) -> NDArray[np.float64]:
    """`local` (n, 3), known points in the camera's axes, none nearer by a SPIKE than the median within two pixels."""
    import cv2

    depth = np.full(known.shape, np.inf, np.float32)
    depth[known] = local[:, 2]
    around = cv2.medianBlur(depth, 5)[known].astype(np.float64)
    stands_out = np.isfinite(around) & (local[:, 2] < around - SPIKE * voxel)
    return local * np.where(stands_out, np.where(stands_out, around, 1.0) / local[:, 2], 1.0)[:, None]
