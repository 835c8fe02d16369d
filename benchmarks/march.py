"""The march on KERNEL's reference scene: the product against a plain march and, where present, the prototypes.

A noisy ball in 256³ voxels, 512² pixels, three point lamps, Torrance–Sparrow shading. All contenders run in this
process in turn, A B C A B C …; no time is tested. `render` is all that a user waits for: tables, maps, picture, its
copy to the host; the others leave their picture on the device. Written to out/bench/march.json.

    python benchmarks/march.py [--rounds 7]
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import count
from typing import Any

import drjit as dr
import numpy as np
from peers_scene import noisy_voxels
from plain_march import DenseGrid, plain_march
from prototypes import prototype_frames
from turns import Frame, in_turn, options, record

import hagoromo as hg
from hagoromo.backend import arrays, opaque_vector
from hagoromo.image.scene.settings import Settings
from hagoromo.transport.film import tile_order
from hagoromo.transport.lighting import Attenuation, Lighting
from hagoromo.transport.march import march
from hagoromo.transport.materials import Materials
from hagoromo.transport.medium import Medium
from hagoromo.transport.palette import palette_of
from hagoromo.transport.shadow import brute_attenuation, mapped_attenuation

VOXELS, PIXELS, TAU = 256, 512, 100.0
LAMPS = ((3.0, 3.0, 3.0), (-3.0, 2.0, 3.0), (0.0, -3.0, 3.0))
TEXELS = 512  # a side of a map, as the prototypes have it
WHITE = hg.Spectrum.constant(1.0)
MATTER = hg.Reflectance(0.25, 0.3, 0.2, 1.5, WHITE)
EYE = (0.0, 0.0, 3.0)


def main() -> None:
    """Run all contenders in turn; print and record medians, and ratios to the product without shadows."""
    rounds = options(__doc__, 7).parse_args().rounds
    scene = ReferenceScene()
    frames = scene.frames() | prototype_frames()
    times = in_turn(frames, rounds)
    base = np.array(times["march, no shadows"])
    rows = [
        {
            "frame": name, "median_s": float(np.median(taken)), "least_s": min(taken),
            "ratio": float(np.median(np.array(taken) / base[: len(taken)])),
        }
        for name, taken in times.items()
    ]  # fmt: skip
    for row in rows:
        print(f"{row['frame']:40s}{row['median_s']:9.4f} s{row['least_s']:9.4f} s{row['ratio']:8.2f}")
    record("march", {"rounds": rounds, "frames": rows, "shadow_error": scene.shadow_errors()})


def reference_lamps(turn: float) -> tuple[hg.Lamp, ...]:
    """The three lamps, turned by `turn` about the z axis [rad]."""
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return tuple(hg.Lamp(position=rotation @ place, intensity=27.0, spectrum=WHITE) for place in LAMPS)


def camera_rays(order: np.ndarray) -> tuple[Any, Any]:
    """Rays of the reference camera, pixels in the given order."""
    jit = arrays()
    pixel = jit.UInt(order)
    x, y = jit.Float(pixel % PIXELS) + 0.5, jit.Float(pixel // PIXELS) + 0.5
    direction = jit.Array3f(x / PIXELS * 2 - 1, 1 - y / PIXELS * 2, -2.5)
    return opaque_vector(EYE), dr.normalize(direction)


class ReferenceScene:
    """KERNEL's scene on the device, and the product's frames of it; the lamps stand elsewhere in each mapped one."""

    def __init__(self) -> None:
        self.voxels, pose = noisy_voxels(), np.eye(4)
        pose[:3, 3] = -1.0
        density, normal = self.voxels[..., 0], self.voxels[..., 1:]
        self.box = hg.VolumeBox.from_arrays(density, normal, 2 / VOXELS, TAU, [MATTER], pose=pose)
        self.materials = Materials([MATTER], palette_of([MATTER], [], [WHITE]))
        self.medium, self.turn = Medium([self.box]), count(1)
        self.tiles = tile_order(PIXELS, PIXELS)

    def lighting(self, lamps: Sequence[hg.Lamp] | None = None, attenuation: Attenuation | None = None) -> Lighting:
        """Light of the lamps, without shadows unless `attenuation` is given."""
        return Lighting(lamps or reference_lamps(0.0), self.materials, attenuation)

    def frame(self, lighting: Lighting) -> Any:
        """Radiance of all pixels, in the order of `tiles`, on the device."""
        channels, _ = march(self.medium, lighting, *camera_rays(self.tiles), arrays().Float(0), arrays().Float(dr.inf))
        return channels[0] + channels[1]

    def mapped(self, turn: float, texels: int | None = TEXELS) -> Any:
        """A frame with maps made for it; texels: a side of a map, None: as many as `render` takes."""
        lamps = reference_lamps(turn)
        return self.frame(self.lighting(lamps, mapped_attenuation(self.medium, lamps, texels)))

    def rendered(self, settings: Settings) -> Any:
        """A frame by `render`."""
        camera = hg.Camera(PIXELS, PIXELS, (1.25 * PIXELS, 1.25 * PIXELS), (PIXELS / 2, PIXELS / 2))
        camera = camera.look_at(EYE, (0, 0, 0), (0, 1, 0))
        hg.render(hg.Scene(camera, reference_lamps(0.05 * next(self.turn)), (self.box,)), settings)

    def frames(self) -> dict[str, Frame]:
        """The product's march and a plain one, without shadows, with maps made anew, by brute march."""
        rows, grid = np.arange(PIXELS**2, dtype=np.uint32), DenseGrid(self.voxels)
        unshaded, brute = self.lighting(), self.lighting(attenuation=brute_attenuation(self.medium))
        return {
            "march, no shadows": lambda: self.frame(unshaded),
            "march, maps 512² made anew": lambda: self.mapped(0.05 * next(self.turn)),
            "render, maps 512² made anew": lambda: self.rendered(Settings(shadow_resolution=TEXELS)),
            "render, maps of its own choice": lambda: self.rendered(Settings()),
            "march, brute shadows": lambda: self.frame(brute),
            "plain march, no shadows": lambda: plain_march(grid, TAU, unshaded, *camera_rays(rows)),
        }

    def shadow_errors(self) -> dict[str, float]:
        """Root mean square of mapped − brute over the mean, where there is matter: maps of TEXELS², and `render`'s."""
        brute = np.array(self.frame(self.lighting(attenuation=brute_attenuation(self.medium))))
        matter, errors = brute > 0.0, {}
        for name, texels in (("512²", TEXELS), ("own choice", None)):
            difference = np.array(self.mapped(0.0, texels)) - brute
            errors[name] = float(np.sqrt(np.mean(difference[matter] ** 2)) / brute[matter].mean())
        return errors


if __name__ == "__main__":
    main()
