"""The scenes that every contender renders: KERNEL's noisy ball and a thin cloud in 256³ voxels, seen by one camera.

The box is the cube −1…1 m, voxel centres edge to edge. The camera stands at (0, 0, 3) m and looks along −z with +y up:
the ray of a pixel goes through (2 x / pixels − 1, 1 − 2 y / pixels, −2.5). Matter is grey and matte: f is α cosθ_i of
its gradient (`plane`) or the mean of that over a sphere, a phase function (`sphere`, MODEL §2).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

VOXELS = 256
VOXEL = 2.0 / VOXELS  # [m]
COMPARED = 64  # pixels a side that are compared with the reference, evenly spread over the picture
ALPHA = 0.3  # [1/sr]
FOCAL = 1.25  # focal length over the width of the picture
EYE = (0.0, 0.0, 3.0)  # [m]
LAMPS = ((3.0, 3.0, 3.0), (-3.0, 2.0, 3.0), (0.0, -3.0, 3.0))  # [m]; for far lamps the directions to them
INTENSITY = 27.0  # irradiance × m² of a near lamp: 1 at the middle of the box for the first
TAU = {"ball": 100.0, "cloud": 1.5}  # [1/m]


@dataclass(frozen=True)
class PeerStudy:
    """One scene and who renders it. far: lamps are directions with an irradiance of 1."""

    name: str
    matter: str
    lamps: int
    peers: tuple[str, ...]
    pixels: int = 512
    element: Literal["plane", "sphere"] = "sphere"
    shadows: bool = True
    far: bool = False


STUDIES = (
    PeerStudy("ball, 1 lamp", "ball", 1, ("mitsuba", "numba")),
    PeerStudy("ball, 3 lamps", "ball", 3, ("mitsuba", "numba")),
    PeerStudy("cloud, 1 lamp, 256 px", "cloud", 1, ("mitsuba", "numba"), pixels=256),
    PeerStudy("ball, 1 lamp, 64 px", "ball", 1, ("mitsuba", "numba", "numpy"), pixels=64),
    PeerStudy("ball, 1 far lamp", "ball", 1, ("vtk volumetric shadows",), far=True),
    PeerStudy("ball, 3 far lamps, no shadows", "ball", 3, ("vtk", "numba", "numpy"), 512, "plane", False, True),
)


@dataclass(frozen=True)
class PeerScene:
    """A study with its matter, read from `folder` where `make_matter` wrote it."""

    study: PeerStudy
    folder: Path

    @cached_property
    def density(self) -> NDArray[np.float32]:
        """Density ρ (z, y, x); the extinction is tau · ρ [1/m]."""
        return np.load(self.folder / f"{self.study.matter}.npy")

    @cached_property
    def axis(self) -> NDArray[np.float32]:
        """Outward normals (z, y, x, 3); zeros where the element has no direction."""
        if self.study.element == "sphere":
            return np.broadcast_to(np.float32(0.0), (*self.density.shape, 3))
        return np.load(self.folder / f"{self.study.matter}_axis.npy")

    @property
    def stride(self) -> int:
        """Of this many pixels in a row, and rows, one is compared with the reference."""
        return self.study.pixels // COMPARED

    def sampled(self, picture: NDArray) -> NDArray:
        """The pixels that are compared: (COMPARED, COMPARED)."""
        return picture[:: self.stride, :: self.stride]

    @property
    def tau(self) -> float:
        """Extinction per unit of density [1/m]."""
        return TAU[self.study.matter]

    @property
    def lamps(self) -> NDArray[np.float64]:
        """Places [m] or, for far lamps, unit directions towards them: (lamps, 3)."""
        lamps = np.array(LAMPS[: self.study.lamps])
        return lamps / np.linalg.norm(lamps, axis=1, keepdims=True) if self.study.far else lamps

    @property
    def directions(self) -> NDArray[np.float64]:
        """Unit directions of the rays through the middles of the pixels: (pixels, pixels, 3)."""
        across = (np.arange(self.study.pixels) + 0.5) / self.study.pixels * 2.0 - 1.0
        x, y = np.meshgrid(across, -across)
        rays = np.stack([x, y, np.full_like(x, -2.0 * FOCAL)], axis=-1)
        return rays / np.linalg.norm(rays, axis=-1, keepdims=True)


def sphere_phase(cos_phase: NDArray[np.float64]) -> NDArray[np.float64]:
    """f [1/sr] of a matte sphere seen at an angle χ from its lamp: α (2/3π)(sin χ + (π−χ) cos χ), MODEL §2."""
    phase = np.arccos(np.clip(cos_phase, -1.0, 1.0))
    return ALPHA * 2.0 / (3.0 * math.pi) * (np.sin(phase) + (math.pi - phase) * np.cos(phase))


def make_matter(folder: Path) -> None:
    """Write the densities of both kinds of matter, and the normals of the ball, into `folder`."""
    ball = noisy_voxels()
    np.save(folder / "ball.npy", ball[..., 0])
    np.save(folder / "ball_axis.npy", ball[..., 1:])
    np.save(folder / "cloud.npy", cloud_density())


def noisy_voxels() -> np.ndarray:
    """Density and outward normal (z, y, x, 4) of the noisy ball of radius 0.8 in the cube −1…1."""
    rng = np.random.default_rng(0)
    centres = (np.arange(VOXELS) + 0.5) / VOXELS * 2 - 1
    z, y, x = np.meshgrid(centres, centres, centres, indexing="ij")
    noise = 0.5 + rng.random((VOXELS,) * 3)
    density = (np.clip((0.8 - np.sqrt(x * x + y * y + z * z)) * 20, 0, 1) * noise).astype(np.float32)
    normal = -np.stack([np.gradient(density, axis=axis) for axis in (2, 1, 0)], -1)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
    return np.concatenate([density[..., None], normal], -1)


def cloud_density() -> NDArray[np.float32]:
    """A ball of radius 0.8 m of smooth noise that thins out to its rim: optical depth about 1 across its middle."""
    from scipy.ndimage import zoom

    rng = np.random.default_rng(1)
    noise = np.zeros((VOXELS,) * 3, np.float32)
    for cells in (8, 16, 32):
        noise += np.asarray(zoom(rng.random((cells,) * 3, np.float32), VOXELS // cells, order=1)) / cells
    noise = (noise - noise.min()) / (noise.max() - noise.min())
    centres = (np.arange(VOXELS) + 0.5) * VOXEL - 1.0
    z, y, x = np.meshgrid(centres, centres, centres, indexing="ij", sparse=True)
    inside = np.clip((0.8 - np.sqrt(x * x + y * y + z * z)) * 4.0, 0.0, 1.0)
    return (inside * noise**2 * 4.0).astype(np.float32)
