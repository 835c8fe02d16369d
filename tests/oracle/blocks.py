"""Homogeneous blocks with a flat face, and the closed form of their light at every density.

I = E f μ_L/(μ_L+μ_V) (1 − exp(−τ (1/μ_L + 1/μ_V))), τ the optical depth along the normal, whatever its profile. Every
lamp has a spectrum of its own, so that one march gives its light apart.
"""

from __future__ import annotations

import numpy as np

import hagoromo as hg
from tests.oracle.lattice import Array
from tests.oracle.scenes import MATTE, block, lamp_above_face

HEIGHTS = (90.0, 60.0, 20.0, 5.0)  # of the lamps above the face [degrees]
LAMPS = tuple(lamp_above_face(height, hg.Spectrum.constant(1.0 + k)) for k, height in enumerate(HEIGHTS))
DEPTHS = (0.5, 1.0, 50.0, 200.0, 1e3, 1e5)  # mean free paths a voxel
FACES = {"hard face": (0, 1), "soft face": (2, 1), "two boxes in one place": (0, 2)}  # empty voxels above it, boxes
THICK, WIDE = 5, 83  # voxels of matter; light from the side passes 17 optical depths at least
RAYS = 97


def rays() -> tuple[Array, Array]:
    """A fan of rays to the middle of the face, 25° to 65° from its normal: origins and unit directions (RAYS, 3)."""
    angle = np.radians(np.linspace(25.0, 65.0, RAYS))
    away = np.stack([0.6 * np.sin(angle), 0.8 * np.sin(angle), np.cos(angle)], axis=-1)
    place = np.stack([np.linspace(-0.02, 0.02, RAYS), np.linspace(0.015, -0.01, RAYS), np.zeros(RAYS)], axis=-1)
    return place + away, -away


def light_over_closed_form(depth_per_voxel: float, face: str, settings: hg.Settings) -> Array:
    """What the march sees of a block over its closed form: (RAYS, lamps)."""
    (margin, boxes), (origin, direction) = FACES[face], rays()
    voxels = block(depth_per_voxel / boxes, margin, (THICK + margin, WIDE, WIDE))
    pose = voxels.pose.copy()
    pose[2, 3] = -THICK * voxels.voxel_size  # the face at z = 0; a soft one falls off about there, over one voxel
    box = voxels.box().with_pose(pose)
    camera = hg.Camera(8, 8, (20.0, 20.0), (4.0, 4.0)).look_at((0.3, 0.4, 0.9), (0.0, 0.0, 0.0))
    march = hg.RayMarch(hg.Scene(camera, LAMPS, (box,) * boxes), settings)
    spectra = [lamp.at(550.0) * body.at(550.0) for lamp in march.palette.lamps for body in march.palette.colours]
    seen = march(origin, direction).weights * np.array(spectra)
    seen = seen.reshape(RAYS, len(LAMPS), -1).sum(axis=2)
    depth, eye, lamp = depth_per_voxel * THICK, -direction[:, 2:3], np.sin(np.radians(HEIGHTS))
    share = -np.expm1(-depth * (1.0 / lamp + 1.0 / eye))
    strength = np.array([lamp.spectrum.at(550.0) for lamp in LAMPS])
    return seen / (strength * MATTE.alpha * lamp * lamp / (lamp + eye) * share)


def error_and_ratio_by_lamp(ratio: Array) -> tuple[Array, Array]:
    """Root mean square error over the mean, and mean ratio, of `light_over_closed_form`: (lamps,) each."""
    return np.sqrt(np.mean((ratio - 1.0) ** 2, axis=0)), ratio.mean(axis=0)
