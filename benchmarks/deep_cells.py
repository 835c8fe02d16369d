"""Deep cells: the light of mode full over that of mode path, as cells of light hold more and more mean free paths.

A cube of matte white spheres of albedo 0.9 under one far lamp, 12 cells wide, with hard faces. The light is that of all
pixels and orders; the noise of the walks is one standard deviation.
"""

from __future__ import annotations

import argparse
import math
import warnings
from collections.abc import Sequence

import numpy as np

import hagoromo as hg
import hagoromo.image.full.picture as full

DEPTHS = (0.5, 1.0, 2.0, 4.0, 7.0)  # mean free paths a cell
ACROSS = 12  # cells along an edge of the cube
TO_LAMP = (0.48, -0.6, 0.64)
ALBEDO = 0.9
SIZE = 16  # pixels along an edge of the picture


def cube(depth: float, voxels: int) -> hg.Scene:
    """A cube of 1 m, `depth` mean free paths wide, of voxels³ voxels."""
    material = hg.Reflectance(ALBEDO / math.pi, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element="sphere")
    axes = np.broadcast_to((0.0, 0.0, 1.0), (voxels, voxels, voxels, 3))
    density = np.ones(axes.shape[:3])
    box = hg.VolumeBox.from_arrays(density, axes, 1 / voxels, 2.0 * depth, [material], extinction="projected")
    focal = (1.6 * SIZE, 1.6 * SIZE)
    camera = hg.Camera(SIZE, SIZE, focal, (SIZE / 2, SIZE / 2)).look_at((1.7, -2.2, 1.6), (0.5, 0.5, 0.5))
    return hg.Scene(camera, (hg.Lamp(to_lamp=TO_LAMP),), (box,))


def light_of(image: hg.Image) -> float:
    """All light of a picture: the mean over its bands, which are one where matter is grey."""
    first = len(image.palette.bodies) + len(image.palette.interfaces)
    return float(image.weights[..., :first].sum() + image.weights[..., first:].mean(axis=-1).sum())


def light_by_cells(depth: float, voxels: int, edge: float, walks: int) -> tuple[float, float]:
    """Light of full over that of path, and its noise: `edge` cells across, of `depth` mean free paths each."""
    scene = cube(depth * edge, voxels)
    full.cell_size = lambda boxes, channels: 1.0 / edge
    walked = hg.render(scene, hg.Settings(samples=walks), mode="path")
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*mean free paths deep in a cell")
        solved = hg.render(scene, hg.Settings(samples=4, walks=0), mode="full")
    assert walked.variance is not None
    ratio = light_of(solved) / light_of(walked)
    return ratio, ratio * math.sqrt(float(walked.variance.sum())) / light_of(walked)


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a row for every depth; cells that end at the faces of the cube, and cells that do not."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--walks", type=int, default=1000, help="walks a pixel of mode path")
    parser.add_argument("--voxels", type=int, default=48, help="along an edge of the cube")
    parser.add_argument("--depths", type=float, nargs="+", default=DEPTHS, help="mean free paths a cell")
    options = parser.parse_args(arguments)
    print("mean free paths a cell   cells end at the faces   cells end within the matter   noise")
    for depth in options.depths:
        (at, noise), (off, _) = (
            light_by_cells(depth, options.voxels, edge, options.walks) for edge in (ACROSS, 0.95 * ACROSS)
        )
        print(f"{depth:22.2g} {at:24.3f} {off:29.3f} {noise:7.3f}", flush=True)


if __name__ == "__main__":
    main()
