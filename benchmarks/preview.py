"""The preview on KERNEL's reference scene: when each picture of a changed scene is there, and what is compiled for it.

A noisy ball in 256³ voxels under three lamps with shadow maps, looked at again and again while one thing changes. Times
are medians over rounds, in seconds after the change; kernels compiled are counted over all of them, and none is
expected. `one tile` is a picture of 4 × 2 pixels without shadows: what Python and launching cost.

    python benchmarks/preview.py [--rounds 5] [--size 512 512] [--size 1920 1080]
"""

from __future__ import annotations

import argparse
import os
import platform
import time
from collections.abc import Callable
from dataclasses import replace

import drjit as dr
import numpy as np
from march import LAMPS, TAU, VOXELS
from peers_scene import noisy_voxels

import hagoromo as hg
from hagoromo.backend import name as backend_name
from hagoromo.image.scene.settings import Settings

WHITE = hg.Spectrum.constant(1.0)
EYE = np.array([0.0, 0.0, 3.0])
Change = Callable[[hg.Scene, int], hg.Scene]


def reference_scene(width: int, height: int) -> hg.Scene:
    """KERNEL's scene through a camera of width × height pixels."""
    voxels, pose = noisy_voxels(), np.eye(4)
    pose[:3, 3] = -1.0
    matter = [hg.Reflectance(0.25, 0.3, 0.2, 1.5, WHITE)]
    box = hg.VolumeBox.from_arrays(voxels[..., 0], voxels[..., 1:], 2 / VOXELS, TAU, matter, pose=pose)
    return hg.Scene(a_camera(width, height, EYE), reference_lamps(0.0), (box,))


def a_camera(width: int, height: int, eye: np.ndarray) -> hg.Camera:
    """KERNEL's camera, at another place or of another size."""
    camera = hg.Camera(width, height, (1.25 * height, 1.25 * height), (width / 2, height / 2))
    return camera.look_at(eye, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))


def reference_lamps(turn: float) -> tuple[hg.Lamp, ...]:
    """KERNEL's lamps, turned about the z axis [rad]."""
    rotation = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
    return tuple(hg.Lamp(position=rotation @ place, intensity=27.0, spectrum=WHITE) for place in LAMPS)


def turned_camera(scene: hg.Scene, k: int) -> hg.Scene:
    """The camera on its way round the box."""
    angle = 0.1 * (k + 1)
    eye = np.array([3.0 * np.sin(angle), 0.0, 3.0 * np.cos(angle)])
    return scene.with_camera(a_camera(scene.camera.width, scene.camera.height, eye))


def other_matter(scene: hg.Scene, k: int) -> hg.Scene:
    """Another reflectance in the box."""
    matter = hg.Reflectance(0.2, 0.3, 0.2 + 0.013 * k, 1.4 + 0.01 * k, WHITE)
    return replace(scene, boxes=(scene.boxes[0].with_materials([matter]),))


def other_place(scene: hg.Scene, k: int) -> hg.Scene:
    """The box shifted."""
    pose = scene.boxes[0].pose.copy()
    pose[0, 3] += 0.02 * k
    return replace(scene, boxes=(scene.boxes[0].with_pose(pose),))


CHANGES: dict[str, Change] = {
    "camera": turned_camera,
    "lamps": lambda scene, k: scene.with_lamps(*reference_lamps(0.1 * (k + 1))),
    "matter": other_matter,
    "box": other_place,
}


def compiled() -> int:
    """Kernels compiled, or read from the cache on disk, since the last call."""
    history = [kernel for kernel in dr.kernel_history() if "cache_hit" in kernel]
    return sum(not kernel["cache_hit"] or kernel["cache_disk"] for kernel in history)


def looks(view: hg.Preview, scene: hg.Scene, change: Change, rounds: int) -> tuple[dict[int, list[float]], int]:
    """Seconds to the picture of each stride, the first one's under 0, and kernels compiled."""
    times: dict[int, list[float]] = {}
    compiled()
    for k in range(rounds):
        changed, start = change(scene, k), time.perf_counter()
        for number, image in enumerate(view.pictures(changed)):
            seconds = time.perf_counter() - start
            for stride in (image.metadata["preview"]["stride"], *((0,) if number == 0 else ())):
                times.setdefault(stride, []).append(seconds)
    return times, compiled()


def one_tile(scene: hg.Scene, rounds: int) -> float:
    """Median time of a picture of 4 × 2 pixels without shadows [s]."""
    view, taken = hg.Preview(Settings(shadows="none")), []
    for k in range(rounds + 1):
        tile = scene.with_camera(a_camera(4, 2, EYE + 0.01 * k))
        start = time.perf_counter()
        next(view.pictures(tile))
        taken.append(time.perf_counter() - start)
    return float(np.median(taken[1:]))


def main() -> None:
    """Print a line for each size and change."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--size", type=int, nargs=2, action="append")
    options = parser.parse_args()
    dr.set_flag(dr.JitFlag.KernelHistory, True)
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, backend {backend_name()}, "
        f"Dr.Jit {dr.__version__}, {time.strftime('%Y-%m-%d')}, {options.rounds} rounds"
    )
    scene, view = reference_scene(512, 512), hg.Preview()
    for change in CHANGES.values():  # compiles, and learns the number of rays that a first picture may have
        looks(view, scene, change, 2)
    print(f"one tile {one_tile(scene, options.rounds):.4f} s")
    print(f"{'size':>12s} {'change':8s}{'compiled':>9s}{'first [s]':>11s}   stride: [s]")
    for width, height in options.size or [(512, 512), (1920, 1080)]:
        sized = scene.with_camera(a_camera(width, height, EYE))
        for name, change in CHANGES.items():
            times, kernels = looks(view, sized, change, options.rounds)
            first = np.median(times.pop(0))
            line = "  ".join(f"{stride}: {np.median(times[stride]):.3f}" for stride in sorted(times, reverse=True))
            print(f"{f'{width}×{height}':>12s} {name:8s}{kernels:9d}{first:11.4f}   {line}", flush=True)


if __name__ == "__main__":
    main()
