"""The march on KERNEL's reference scene: the product against a plain march and, where present, the prototypes.

A noisy ball in 256³ voxels, half-voxel steps, 512² pixels, three point lamps, Torrance–Sparrow shading. All
contenders run in this process in turn, A B C A B C …; the medians and their ratios are printed, and no ratio is
tested. Frames only: grids stay on the device, images are not copied back. The prototypes (../shared/prototypes) run
in a temporary folder.

    python benchmarks/march.py [--rounds 7] [--shadows]
"""

from __future__ import annotations

import argparse
import os
import platform
import shutil
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import mitsuba
import numpy as np

from hagoromo.backend import arrays, opaque_vector
from hagoromo.backend import name as backend_name
from hagoromo.image.lighting import Lighting, Materials, palette_of
from hagoromo.image.march import CUT, march
from hagoromo.image.render import tile_order
from hagoromo.image.shadow import brute_attenuation, mapped_attenuation
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.medium import Medium

VOXELS, PIXELS, TAU = 256, 512, 100.0
LAMPS = ((3.0, 3.0, 3.0), (-3.0, 2.0, 3.0), (0.0, -3.0, 3.0))
PROTOTYPES = Path(__file__).resolve().parents[2] / "shared" / "prototypes"
Frame = Callable[[], Any]


def reference_voxels() -> np.ndarray:
    """Density and outward normal (z, y, x, 4) of the noisy ball of radius 0.8 in the cube −1…1."""
    rng = np.random.default_rng(0)
    centres = (np.arange(VOXELS) + 0.5) / VOXELS * 2 - 1
    z, y, x = np.meshgrid(centres, centres, centres, indexing="ij")
    noise = 0.5 + rng.random((VOXELS,) * 3)
    density = (np.clip((0.8 - np.sqrt(x * x + y * y + z * z)) * 20, 0, 1) * noise).astype(np.float32)
    normal = -np.stack([np.gradient(density, axis=axis) for axis in (2, 1, 0)], -1)
    normal /= np.maximum(np.linalg.norm(normal, axis=-1, keepdims=True), 1e-6)
    return np.concatenate([density[..., None], normal], -1)


def camera_rays(order: np.ndarray) -> tuple[Any, Any]:
    """Rays of the reference camera, pixels in the given order."""
    kinds = arrays()
    pixel = kinds.UInt(order)
    x, y = kinds.Float(pixel % PIXELS) + 0.5, kinds.Float(pixel // PIXELS) + 0.5
    direction = kinds.Array3f(x / PIXELS * 2 - 1, 1 - y / PIXELS * 2, -2.5)
    return opaque_vector((0, 0, 3)), dr.normalize(direction)


@dr.syntax
def plain(grid: Any, lighting: Lighting, origin: Any, direction: Any) -> Any:
    """The march as one writes it first: a dense grid in single precision, every half voxel, nothing skipped."""
    kinds, step = arrays(), 1.0 / VOXELS
    near, far = (-1.0 - origin) / direction, (1.0 - origin) / direction
    t = dr.fmax(dr.max(dr.minimum(near, far)), 0.0) + 0.5 * step
    end = dr.min(dr.maximum(near, far))
    passed = dr.ones(kinds.Float, dr.width(direction))
    channels = [dr.zeros(kinds.Float, dr.width(direction)) for _ in range(2)]
    while (t < end) & (passed > CUT):
        point = dr.fma(direction, t, origin)
        voxel = trilinear(grid, point)
        depth = TAU * voxel[0] * step
        if depth > 1e-6:
            axis = dr.normalize(kinds.Array3f(voxel[1], voxel[2], voxel[3]) + 1e-9)
            material = kinds.UInt(0)
            met = lighting.reflected(point, -direction, axis, material, lighting.materials.coefficients(material))
            gain = passed * (1.0 - dr.exp(-depth))
            channels = [dr.fma(gain, met[0], channels[0]), dr.fma(gain, met[1], channels[1])]
            passed *= dr.exp(-depth)
        t += step
    return channels[0] + channels[1]


class Grid:
    """A dense grid, held in a plain object so that loops do not take it into their state."""

    def __init__(self, voxels: np.ndarray) -> None:
        self.values = arrays().Float(voxels.ravel())


def trilinear(grid: Grid, point: Any) -> Any:
    """Density and normal at a point of the cube −1…1."""
    kinds = arrays()
    place = (point * 0.5 + 0.5) * VOXELS - 0.5
    cell = dr.minimum(dr.maximum(kinds.Array3i(dr.floor(place)), 0), VOXELS - 2)
    part = place - kinds.Array3f(cell)
    part = kinds.Array3f(*(dr.fmin(dr.fmax(part[k], 0.0), 1.0) for k in range(3)))
    total: Any = 0.0
    for z, y, x in np.ndindex(2, 2, 2):
        weight = (part.z if z else 1 - part.z) * (part.y if y else 1 - part.y) * (part.x if x else 1 - part.x)
        index = ((cell.z + int(z)) * VOXELS + cell.y + int(y)) * VOXELS + cell.x + int(x)
        total = total + weight * dr.gather(kinds.Array4f, grid.values, kinds.UInt(index))
    return total


def prototype_frames(shadows: bool) -> dict[str, Frame]:
    """The prototypes' best frames: distance skipping, halves, tiles; with shadows, maps of 512², 32 slices."""
    if not (PROTOTYPES / "q2.py").exists() or backend_name() != "llvm":
        print(f"prototypes: not here ({PROTOTYPES.name} absent, or another backend than llvm), left out")
        return {}
    folder = tempfile.mkdtemp()
    for script in PROTOTYPES.glob("*.py"):
        shutil.copy(script, folder)
    os.chdir(folder)
    sys.path.insert(0, folder)
    sys.argv = sys.argv[:1]  # the scripts read theirs when they are imported
    import mkgrid  # pyright: ignore[reportMissingImports]

    np.save("vox256.npy", mkgrid.make(256))
    import q2  # pyright: ignore[reportMissingImports]

    frames: dict[str, Frame] = {"prototype": lambda: q2.render(q2.sh_none)}
    if shadows:

        def mapped() -> Any:
            maps = [q2.dsm_one(lamp, 512, 32, q2.STEP, 10.0) for lamp in q2.Ls]
            dr.eval(maps)
            return q2.render(q2.sh_dsm(maps, 512, 32))

        frames["prototype, maps made and used"] = mapped
    return frames


def product_frames(shadows: bool) -> dict[str, Frame]:
    """The product's march and its plain oracle; with shadows, maps and the brute march."""
    voxels = reference_voxels()
    material = Reflectance(0.25, 0.3, 0.2, 1.5, Spectrum.constant(1.0))
    pose = np.eye(4)
    pose[:3, 3] = -1.0
    box = VolumeBox.from_arrays(voxels[..., 0], voxels[..., 1:], 2 / VOXELS, TAU, [material], pose=pose)
    materials = Materials([material], palette_of([material], [], [Spectrum.constant(1.0)]))
    lamps = [Lamp(position=place, intensity=27.0) for place in LAMPS]
    medium, lighting, grid = Medium([box]), Lighting(lamps, materials), Grid(voxels)
    tiles, rows = tile_order(PIXELS, PIXELS), np.arange(PIXELS**2, dtype=np.uint32)
    far = arrays().Float(1e9)

    def frame(light: Lighting) -> Any:
        channels, _ = march(medium, light, *camera_rays(tiles), arrays().Float(0), far)
        return channels[0] + channels[1]

    frames: dict[str, Frame] = {
        "product": lambda: frame(lighting),
        "plain march": lambda: plain(grid, lighting, *camera_rays(rows)),
    }
    if shadows:

        def mapped() -> Any:
            return frame(Lighting(lamps, materials, mapped_attenuation(medium, lamps, 512)))

        frames["product, maps made and used"] = mapped
        frames["product, brute shadows"] = lambda: frame(Lighting(lamps, materials, brute_attenuation(medium)))
    return frames


def seconds(frame: Frame) -> float:
    """Wall time of one frame [s]."""
    start = time.perf_counter()
    dr.eval(frame())
    dr.sync_thread()
    return time.perf_counter() - start


def main() -> None:
    """Run all contenders in turn and print medians and ratios to the product."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=7)
    parser.add_argument("--shadows", action="store_true")
    options = parser.parse_args()
    frames = product_frames(options.shadows) | prototype_frames(options.shadows)
    first = {name: seconds(frame) for name, frame in frames.items()}
    times: dict[str, list[float]] = {name: [] for name in frames}
    for _ in range(options.rounds):
        for name, frame in frames.items():
            times[name].append(seconds(frame))
    product = np.array(times["product"])
    print(
        f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, backend {backend_name()}, "
        f"Dr.Jit {dr.__version__}, Mitsuba {mitsuba.__version__}, {time.strftime('%Y-%m-%d')}, {options.rounds} rounds"
    )
    print(f"{'':34s}{'first [s]':>10s}{'median [s]':>12s}{'min [s]':>9s}{'median of time / product':>27s}")
    for name, taken in times.items():
        ratio = float(np.median(np.array(taken) / product))
        print(f"{name:34s}{first[name]:10.3f}{np.median(taken):12.4f}{min(taken):9.4f}{ratio:27.2f}")


if __name__ == "__main__":
    main()
