"""Relief: a surface seen from one side → volume boxes, a thin opaque skin of particles with the measured reflectance.

Particles in a skin shade each other: with the light attenuated on its way in and out, an opaque skin of particles
that reflect f shows f cosθ_i / (cosθ_i + cosθ_r) (Lommel 1889, Seeliger 1887). Two kinds of particle in equal parts
undo this: plane ones of 2 α cosθ_i and round ones, which show all lamps alike, of 2 α cosθ_r: α cosθ_i in sum.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.light.spectrum import smooth_rgb_basis
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox

EDGE = 2.0  # voxels from outside to full density, measured along the normal
SKIN = 6.0  # voxels of matter along the normal
DEPTH = 9.0  # optical depth of the skin: 1e-4 passes, and the mean free path is longer than a step of the march
STEEPEST = 0.15  # least cosine to the line of sight for thickness: a steeper skin would be deeper than the object
MARGIN = 4  # voxels around the surface


@dataclass(frozen=True, eq=False)
class Relief:
    """A measured surface: points (h, w, 3) [m], world, 0 where unknown; normals (h, w, 3) unit; body (h, w, 3) α c_b
    per pixel on `smooth_rgb_basis`; labels (h, w) of its materials, −1 unknown.
    """

    points: NDArray[np.floating]
    normals: NDArray[np.floating]
    body: NDArray[np.floating]
    labels: NDArray[np.integer]


def relief_boxes(
    relief: Relief, camera: Camera, materials: Sequence[Reflectance], phase: float, name: str = "relief"
) -> tuple[VolumeBox, VolumeBox]:
    """Two volume boxes in one place, of plane and of round particles, that show `relief` as `camera` saw it.

    The boxes lie along the camera's axes (x right, y down, z away) and see the surface as a height field from afar:
    voxels of one pixel at its mean depth. materials: by label; the body colour of a voxel is that of its pixel.
    phase: usual angle between lamp and eye [rad], for which the round particles are right.
    `InputError` when nothing is known, or twice the reflectance breaks energy conservation (dim the gauge of α, β).
    """
    known = np.asarray((np.linalg.norm(relief.points, axis=2) > 0) & (np.linalg.norm(relief.normals, axis=2) > 0.5))
    known &= relief.labels >= 0
    if not known.any():
        raise InputError("the relief has no pixel with point, normal and label: there is nothing to fill")
    rows, columns = np.nonzero(known)
    pose = camera.world_to_camera[:3]
    local = relief.points[rows, columns] @ pose[:, :3].T + pose[:, 3]
    voxel = float(local[:, 2].mean() / np.mean(camera.focal))
    crop = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    near = local[:, 2].min() - MARGIN * voxel
    height = np.zeros(known.shape)
    height[rows, columns] = (local[:, 2] - near) / voxel
    facing = relief.normals @ pose[:, :3].T
    alphas = np.array([material.alpha for material in materials])
    colour = relief.body / alphas[np.maximum(relief.labels, 0)][..., None]
    deepest = float(height[rows, columns].max()) + SKIN / STEEPEST
    tall, wide = known[crop].shape
    shape = (wide + 2 * MARGIN, tall + 2 * MARGIN, int(np.ceil(deepest)) + MARGIN)
    first = (np.array([columns.min(), rows.min()]) - MARGIN - camera.principal) * voxel
    to_world = camera.camera_to_world.copy()
    to_world[:3, 3] += to_world[:3, :3] @ np.array([*first, near])
    # closed form of the sphere element, MODEL §2
    round_share = 2.0 / (3.0 * math.pi) * (math.sin(phase) + (math.pi - phase) * math.cos(phase))
    plane = [replace(m, alpha=2.0 * m.alpha, beta=2.0 * m.beta, element="plane") for m in materials]
    sphere = [replace(m, alpha=2.0 * m.alpha / round_share, beta=0.0, element="sphere") for m in materials]
    seen = np.maximum(-facing[..., 2:], 0.0)
    boxes = []
    for kind, reflectances, colours in (("plane", plane, colour), ("round", sphere, colour * seen)):
        field = _Field(known[crop], height[crop], facing[crop], colours[crop], relief.labels[crop], voxel)
        tau, record = 0.5 * DEPTH / (SKIN * voxel), {"basis": smooth_rgb_basis(), "name": f"{name}, {kind}"}
        boxes.append(VolumeBox.from_field(field, shape, voxel, tau, reflectances, pose=to_world, **record))
    return boxes[0], boxes[1]


class _Field:
    """Density, axis, material and body colour at box coordinates [m], from images of the surface on the device."""

    def __init__(
        self,
        known: NDArray[np.bool_],
        height: NDArray[np.float64],
        facing: NDArray[np.float64],
        colour: NDArray[np.float64],
        labels: NDArray[np.integer],
        voxel: float,
    ) -> None:
        kinds = arrays()
        self.rows, self.columns = known.shape
        self.voxel = float(voxel)
        self.known = kinds.Float(known.astype(np.float32).ravel())
        self.height = kinds.Float(height.astype(np.float32).ravel())
        self.facing = [kinds.Float(facing[..., i].astype(np.float32).ravel()) for i in range(3)]
        self.colour = [kinds.Float(colour[..., i].astype(np.float32).ravel()) for i in range(3)]
        self.labels = kinds.UInt(np.maximum(labels, 0).astype(np.uint32).ravel())

    def __call__(self, p: Any) -> tuple[Any, Any, Any, list[Any]]:
        kinds = arrays()
        x, y, z = (p[i] / self.voxel for i in range(3))
        column, row = x - MARGIN, y - MARGIN
        inside = (column >= 0.0) & (row >= 0.0) & (column < self.columns) & (row < self.rows)
        at = kinds.UInt(clip(row, 0.0, self.rows - 1.0)) * self.columns + kinds.UInt(
            clip(column, 0.0, self.columns - 1.0)
        )
        inside &= dr.gather(kinds.Float, self.known, at) > 0.5
        axis = kinds.Array3f(*(dr.gather(kinds.Float, part, at) for part in self.facing))
        # below the plane through the surface point: distance along the normal
        below = (z - dr.gather(kinds.Float, self.height, at)) * dr.fmax(-axis.z, STEEPEST)
        density = _rising(below / EDGE + 0.5) * _rising((SKIN + 0.5 * EDGE - below) / EDGE)
        colours = [dr.gather(kinds.Float, part, at) for part in self.colour]
        return dr.select(inside, density, 0.0), axis, dr.gather(kinds.UInt, self.labels, at), colours


def _rising(t: Any) -> Any:
    """0 below 0, 1 above 1, a smooth cubic between."""
    t = clip(t, 0.0, 1.0)
    return t * t * (3.0 - 2.0 * t)
