"""Shells: hollow balls of matter in a cube of 1 m, at any resolution: the same matter, lamps and camera throughout.

`FUZZY` is 12 mm thick, in curls: 4–5 % of the bricks of 1024³ voxels hold matter. `THIN` is 0.6 mm thick: less than
1 % of the bricks of 4096³.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np

import hagoromo as hg
from hagoromo_matter.noise import value_noise

WHITE = hg.Spectrum.constant(1.0)
MATTER = hg.Reflectance(0.2, 0.3, 0.2, 1.5, hg.Spectrum.constant(0.8), name="grey")
MIDDLE = np.full(3, 0.5)  # of the shell [m]
RADIUS = 0.4  # [m]
CURL = 0.004  # cell of the noise [m]
LAMPS = np.array([(2.0, -1.5, 2.5), (-1.5, -2.0, 1.5), (0.5, -2.5, -1.0)])  # from the middle [m]
EYE = np.array([0.0, -1.8, 0.3])  # from the middle [m]
INTENSITY = 8.0  # of all lamps together: irradiance × m²


@dataclass(frozen=True)
class Shell:
    """thickness [m]; tau: extinction per unit of density [1/m]."""

    name: str
    thickness: float
    tau: float

    def box(self, voxels: int) -> hg.VolumeBox:
        """The shell in one box of `voxels`³."""
        return self.part(voxels, (1, 1, 1), (0, 0, 0))

    def part(self, voxels: int, parts: tuple[int, int, int], place: tuple[int, ...]) -> hg.VolumeBox:
        """One of the boxes into which the cube is cut: `parts` of them along x, y and z."""
        nx, ny, nz = (voxels // count for count in parts)
        pose = np.eye(4)
        pose[:3, 3] = np.array(place) / np.array(parts)
        shift = pose[:3, 3].tolist()
        return hg.VolumeBox.from_field(
            lambda point: self.field(point + shift), (nx, ny, nz), 1.0 / voxels, self.tau, [MATTER],
            lambda middle, radius: self.occupied(middle + shift, radius), pose=pose,
        )  # fmt: skip

    def field(self, point: Any) -> tuple[Any, Any]:
        """Density 0…4 and outward normal at points [m]."""
        out = point - MIDDLE.tolist()
        radius = dr.norm(out)
        inside = dr.fmax(1.0 - abs(radius - RADIUS) * (2.0 / self.thickness), 0.0)
        return inside * 4.0 * value_noise(point / CURL, 1), out / radius

    def occupied(self, middle: Any, radius: float) -> Any:
        """Whether a ball [m] may hold matter."""
        return abs(dr.norm(middle - MIDDLE.tolist()) - RADIUS) < 0.5 * self.thickness + radius


FUZZY = Shell("fuzzy", 0.012, 300.0)
THIN = Shell("thin", 0.0006, 6000.0)


def camera(pixels: int) -> hg.Camera:
    """A camera of pixels² that sees all of the shell."""
    focal = 1.7 * pixels
    seen = hg.Camera(pixels, pixels, (focal, focal), (pixels / 2, pixels / 2))
    return seen.look_at(MIDDLE + EYE, MIDDLE)


def lamps(count: int, turn: float = 0.0) -> tuple[hg.Lamp, ...]:
    """Point lamps round the shell, turned by `turn` about the upright axis through its middle [rad]."""
    made = []
    for k in range(count):
        x, y, z = LAMPS[k % len(LAMPS)]
        angle = turn + 0.3 * (k // len(LAMPS))
        place = (x * np.cos(angle) - y * np.sin(angle), x * np.sin(angle) + y * np.cos(angle), z)
        made.append(hg.Lamp(position=MIDDLE + place, intensity=INTENSITY / count, spectrum=WHITE))
    return tuple(made)
