"""Relief: a surface seen from one side → a volume box, a thin opaque skin of plane particles with its reflectance.

Particles in a skin shade each other: with the light attenuated on its way in and out, an opaque skin of particles
that reflect f shows f cosθ_i / (cosθ_i + cosθ_r) (Lommel 1889, Seeliger 1887), and where it bends some light passes the
terminator. A surface does not: the box has a `shadow_bias` past its own skin, and shows f under every lamp.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.matter.relief.relief_field import DEPTH, LEAST_SKIN_COSINE, SKIN_VOXELS, ReliefField, ReliefLattice
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.store.plan import BoxPlan

SPIKE = 3.0  # voxels by which a single pixel may stand out towards the eye: spikes of the rim would throw shadows
MARGIN_VOXELS = 4  # voxels around the surface
# [voxels] from the visible surface past the outer half of the edge
SHADOW_BIAS_VOXELS = 1.0


@dataclass(frozen=True, eq=False)
class Relief:
    """A measured surface: points (h, w, 3) [m], world, 0 where unknown; normals (h, w, 3) unit; body (h, w, j) α c_b
    per pixel on a basis of j spectra; labels (h, w) of its materials, −1 unknown. surfaces: (h, w) labels of what is
    alike in all but its gloss, between whose pixels normals and colours go over; None: the materials.
    """

    points: NDArray[np.floating]
    normals: NDArray[np.floating]
    body: NDArray[np.floating]
    labels: NDArray[np.integer]
    surfaces: NDArray[np.integer] | None = None

    def known(self) -> NDArray[np.bool_]:
        """(h, w) pixels with point, normal and label; `InputError` without any."""
        known = (np.linalg.norm(self.points, axis=2) > 0) & (np.linalg.norm(self.normals, axis=2) > 0.5)
        known &= self.labels >= 0
        if not known.any():
            raise InputError("the relief has no pixel with point, normal and label: there is nothing to fill")
        return np.asarray(known, np.bool_)


def relief_plan(
    relief: Relief,
    camera: Camera,
    materials: Sequence[Reflectance],
    basis: Sequence[Spectrum] | None = None,
) -> BoxPlan:
    """The box of the skin of `relief`, as `camera` saw it.

    The box lies along the camera's axes (x right, y down, z away), with voxels of one pixel at the mean depth.
    materials: by label, of the surface; the body colour of a voxel is that of its pixel, on `basis` (default
    `smooth_rgb_basis`), over α. `InputError` when nothing is known or the lens is distorted.
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
    behind = local * (
        1.0 + SKIN_VOXELS / LEAST_SKIN_COSINE * voxel / local[:, 2:]
    )  # where the skin of a steep pixel may end
    low = np.minimum(local, behind).min(axis=0) - MARGIN_VOXELS * voxel
    high = np.maximum(local, behind).max(axis=0) + MARGIN_VOXELS * voxel
    low[2] = max(low[2], 0.5 * local[:, 2].min())
    # a voxel has the colour of one pixel: their centres coincide at the mean depth
    low[:2] = (np.floor(low[:2] / voxel + camera.principal) - camera.principal) * voxel
    to_world = camera.camera_to_world.copy()
    to_world[:3, 3] += to_world[:3, :3] @ low
    facing = relief.normals @ pose[:, :3].T
    alphas = np.array([material.alpha for material in materials])
    colour = relief.body / alphas[np.maximum(relief.labels, 0)][..., None]
    places = np.zeros((*known.shape, 3))
    places[known] = local - low
    surfaces = relief.labels if relief.surfaces is None else relief.surfaces
    field = ReliefField(known, places, facing, colour, (relief.labels, surfaces), ReliefLattice(camera, low, voxel))
    shape = tuple(int(count) for count in np.ceil((high - low) / voxel))
    header = BoxHeader(
        voxel,
        DEPTH / (SKIN_VOXELS * voxel),
        tuple(replace(material, element="plane") for material in materials),
        to_world,
        tuple(smooth_rgb_basis() if basis is None else basis),
        "relief",
        shadow_bias=SHADOW_BIAS_VOXELS * voxel,
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
