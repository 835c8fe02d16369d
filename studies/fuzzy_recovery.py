"""Recoveries of fuzzy matter: balls of down and fur, against new views, and against their own densities."""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from skimage.measure import marching_cubes

import hagoromo as hg
from hagoromo.backend import vectors
from hagoromo.camera.response import camera_white
from hagoromo.image.relight.stage import basis_camera
from hagoromo_recovery.choices import MatterChoice
from hagoromo_recovery.fuzzy_shape import FuzzyShape
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.shading.shading import coordinates
from studies.fuzzy_scenes import down, down_colours, feather, fur, fuzzy_simulated, linen, skin
from studies.recover_scenes import Simulated, shots
from studies.recovery_scores import box_psnr, covered, gloss_held, psnr, surface_errors

Array = NDArray[np.float64]
SEED = 1
NEAR, FAR = (5.0, 60.0), (80.0, 110.0)  # ° off the eye, of lamps like those taken, and of those from the side


@dataclass(frozen=True)
class FuzzyRow:
    """Scores of fuzzy matter. matter: the law that it was recovered by. new, far: see `RecoveryRow`. box: how much
    worse its box shows the latter through `render` [dB]. surface: mean distance of true points from the surface, % of
    the lattice's edge; beta, gamma: error [%]. held, covered: see `RecoveryRow`; None where errors are not stated.
    """

    case: str
    side: int
    matter: str
    new: float
    far: float
    box: float
    seconds: float
    surface: float | None = None
    beta: float | None = None
    gamma: float | None = None
    held: bool | None = None
    covered: tuple[float, float, float] | None = None


class FuzzyCase(NamedTuple):
    """A box of fuzzy matter, the law that it is recovered by, nodes, and whether errors are stated. size: of the scene,
    of that of down and fur. pixels: along an edge of a photograph.
    """

    made: Callable[[], hg.VolumeBox]
    law: MatterChoice
    side: int = 32
    errors: bool = False
    size: float = 1.0
    pixels: int = 160


FUZZY_CASES = {
    "down_fuzzy": FuzzyCase(down, "fuzzy"),
    "down_surface": FuzzyCase(down, "surface"),
    "fur_fuzzy": FuzzyCase(fur, "fuzzy"),
    "fur_surface": FuzzyCase(fur, "surface"),
    "down_errors": FuzzyCase(down, "fuzzy", errors=True),
    "fur_errors": FuzzyCase(fur, "fuzzy", errors=True),
    "down_errors64": FuzzyCase(down, "fuzzy", 64, True),
    "fur_errors64": FuzzyCase(fur, "fuzzy", 64, True),
    "linen": FuzzyCase(linen, "fuzzy", 48, size=0.4, pixels=96),
    "feather": FuzzyCase(feather, "fuzzy", 48, pixels=96),
    "skin": FuzzyCase(skin, "fuzzy", 48, size=0.15, pixels=96),
    "skin_surface": FuzzyCase(skin, "surface", 48, size=0.15, pixels=96),
}
FUZZY_STEPS, FUZZY_RAYS = 60, 1 << 13  # of a recovery of fuzzy matter
POINTS = 7  # every how many true points of the surface one counts


@functools.cache
def fuzzy_captures(
    made: Callable[[], hg.VolumeBox], size: float, pixels: int
) -> tuple[Simulated, Simulated, Simulated]:
    """Photographs of a box with noise, and exact ones under new lamps like those, and from the side."""
    box = made()
    used = fuzzy_simulated(box, shots(36, 5, 60, SEED, pixels), SEED, size=size)
    new, far = (
        fuzzy_simulated(box, shots(6, *lamps, seed, pixels), noise=False, size=size)
        for lamps, seed in ((NEAR, 2), (FAR, 3))
    )
    return used, new, far


class TrueSurface(NamedTuple):
    """Points (n, 3) [m] of the surface that stands for a box, its normals there, and body colours (n, 3)."""

    points: Array
    normals: Array
    colours: Array


@functools.cache
def true_surface(made: Callable[[], hg.VolumeBox]) -> TrueSurface:
    """Where the clearest way out of a box has the optical depth ½, on its own lattice of voxels."""
    box = made()
    density = box.bricks.dense()[0].astype(np.float32) * (box.tau * box.voxel_size)
    lattice = Lattice(box.pose[:3, 3] + 0.5 * box.voxel_size, box.voxel_size, density.shape)
    nothing = np.zeros((*density.shape, 3), np.float32)
    surface = FuzzyShape(lattice, density, nothing, nothing, nothing[..., 0], coordinates(1.0, 0.1, 1.5)).surface()
    corners, _, normals, _ = marching_cubes(surface.distance, 0.0)
    points = lattice.to_world(corners[::POINTS, ::-1])
    return TrueSurface(points, -normals[::POINTS, ::-1].astype(np.float64), true_colours(box, points))


def true_colours(box: hg.VolumeBox, points: Array) -> Array:
    """Body colours (n, 3) at points [m], as the camera reads them relative to a white plane."""
    if box.name == "down":
        return np.stack([np.array(each, np.float64) for each in down_colours(vectors(points))], axis=1)
    body, response = box.materials[0].body_colour, basis_camera()
    return np.broadcast_to(camera_white(body, response), (len(points), 3))


def measured_fuzzy(case: str) -> FuzzyRow:
    """Recover fuzzy matter from 36 views, a near lamp each, and compare it with six new views of each kind."""
    given = FUZZY_CASES[case]
    capture, new, far = fuzzy_captures(given.made, given.size, given.pixels)
    settings = hg.RecoverySettings(given.side, FUZZY_STEPS, FUZZY_RAYS, keep=0, errors=given.errors, matter=given.law)
    begin = time.process_time()
    found = hg.recover(capture.capture, settings)
    seconds, scores = time.process_time() - begin, (psnr(found, new), psnr(found, far))
    row = FuzzyRow(case, given.side, found.matter, *scores, scores[1] - box_psnr(found, far), seconds)
    if not given.errors:
        return row
    true, hair = true_surface(given.made), given.made().materials[0]
    seen = surface_errors(found, true.points, true.normals)
    edge = max(found.lattice.shape) * found.lattice.voxel
    beta, gamma = found.beta / hair.beta - 1.0, found.gamma / hair.gamma - 1.0
    return replace(
        row, surface=100.0 * float(seen.distances.mean()) / edge, beta=100.0 * beta, gamma=100.0 * gamma,
        held=gloss_held(found, hair.beta, hair.gamma), covered=covered(found, seen, true.colours),
    )  # fmt: skip
