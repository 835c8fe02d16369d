"""The gradient of light along rays in reverse mode, in units of the forward march of the same light.

A soft ball of 64³ voxels under one lamp, and a noisy block of the same size without empty voxels, seen along 128² rays.
All contenders run in this process in turn, A B C A B C …; no time is tested. The forward march is `gradient` by
nothing: the same samples, and their copy to the host. Written to out/bench/gradient.json.

    python benchmarks/gradient.py [--rounds 7]
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from turns import in_turn, medians, options, record

import hagoromo as hg

VOXELS, PIXELS, SIDE = 64, 128, 0.24  # SIDE of the box [m]
LENS = 2.9 * PIXELS  # [pixel]
DEPTH = 20.0  # optical depths through the middle
MATTER = hg.Reflectance(0.25, 0.3, 0.25, 1.5, hg.Spectrum.constant(1.0))
EYE, LAMP = (0.0, -0.75, 0.4), hg.Lamp(to_lamp=(0.48, -0.6, 0.64))
ASKED = {
    "forward march": (),
    "gradient by density": ("density",),
    "gradient by density, axis, materials": ("density", "axis", "materials"),
    "gradient by rays": ("rays",),
}


def main() -> None:
    """Run all contenders in turn; print and record medians and their ratios to the forward march."""
    rounds, rows = options(__doc__, 7).parse_args().rounds, []
    for matter, density in (("ball", ball()), ("block", block())):
        for shadows in ("none", "march"):
            times = medians(in_turn(contenders(scene_of(density), shadows), rounds))
            for name, taken in times.items():
                ratio = taken / times["forward march"]
                rows.append({"matter": matter, "shadows": shadows, "what": name, "median_s": taken, "ratio": ratio})
                print(f"{matter:6s} shadows {shadows:6s}{name:40s}{taken:9.4f} s{ratio:8.2f}", flush=True)
    record("gradient", {"rounds": rounds, "rays": PIXELS**2, "rows": rows})


def contenders(scene: hg.Scene, shadows: Any) -> dict[str, Callable[[], Any]]:
    """The march with and without gradients, and light by a call, whose samples are fitted to each other."""
    rays, ways = hg.RayMarch(scene, hg.Settings(shadows=shadows), differentiable=True), pixel_rays(scene.camera)
    by_light = np.random.default_rng(0).uniform(0.5, 1.0, rays(*ways).weights.shape)

    def frame(by: tuple[str, ...]) -> Callable[[], None]:
        def run() -> None:
            rays.gradient(*ways, by_light, by=by)

        return run

    def call() -> None:
        rays(*ways)

    return {name: frame(by) for name, by in ASKED.items()} | {"light by a call": call}


def centres() -> list[NDArray]:
    """Coordinates z, y, x of the voxels from the middle [m]."""
    along = (np.arange(VOXELS) + 0.5) / VOXELS * SIDE - 0.5 * SIDE
    return list(np.meshgrid(along, along, along, indexing="ij"))


def ball() -> NDArray:
    """Density 1 within 5 cm, 0 beyond 10 cm: seven voxels of ten are empty."""
    z, y, x = centres()
    return np.clip((0.1 - np.sqrt(x * x + y * y + z * z)) / 0.05, 0.0, 1.0)


def block() -> NDArray:
    """Noise."""
    return np.random.default_rng(1).uniform(0.3, 1.0, (VOXELS,) * 3)


def scene_of(density: NDArray) -> hg.Scene:
    """A box of planes that face outwards, about the origin."""
    outwards = np.stack(centres()[::-1], axis=-1)
    axis = outwards / np.maximum(np.linalg.norm(outwards, axis=-1, keepdims=True), 1e-9)
    pose = np.eye(4)
    pose[:3, 3] = -0.5 * SIDE
    box = hg.VolumeBox.from_arrays(density, axis, SIDE / VOXELS, DEPTH / 0.15, [MATTER], pose=pose)
    camera = hg.Camera(PIXELS, PIXELS, (LENS, LENS), (0.5 * PIXELS, 0.5 * PIXELS)).look_at(EYE, (0.0, 0.0, 0.0))
    return hg.Scene(camera, (LAMP,), (box,))


def pixel_rays(camera: hg.Camera) -> tuple[NDArray, NDArray]:
    """Rays through the centres of all pixels: origins and directions (rays, 3)."""
    row, column = (np.mgrid[: camera.height, : camera.width] + 0.5).reshape(2, -1)
    (fx, fy), (cx, cy) = camera.focal, camera.principal
    turn, shift = camera.world_to_camera[:3, :3], camera.world_to_camera[:3, 3]
    ways = np.stack([(column - cx) / fx, (row - cy) / fy, np.ones_like(row)], axis=-1) @ turn
    return np.broadcast_to(-turn.T @ shift, ways.shape), ways


if __name__ == "__main__":
    main()
