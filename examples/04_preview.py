"""Turn a lamp round an object: a first picture of every scene in time, and of the last one all up to the render."""

import sys
import time
from pathlib import Path

import drjit as dr
import numpy as np

import hagoromo as hg

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
folder.mkdir(parents=True, exist_ok=True)

SIDE, VOXEL = 0.096, 0.001  # [m]
wool = hg.Reflectance(0.2, 0.3, 0.4, 1.5, body_colour=hg.Spectrum.constant(1.0), element="cylinder", name="wool")


def ball_of_wool(point):
    """Density 0…1 and the direction of the yarn at points of the box [m]."""
    offset = point - SIDE / 2
    radius, angle = dr.norm(offset), dr.atan2(offset.y, offset.x)
    surface = 0.035 + 0.003 * dr.sin(12.0 * angle + 300.0 * offset.z)
    return dr.fmin(dr.fmax(0.5 * (surface - radius) / VOXEL, 0.0), 1.0), type(point)(-offset.y, offset.x, 0.3 * radius)


box = hg.VolumeBox.from_field(ball_of_wool, (96, 96, 96), VOXEL, tau=0.5 / VOXEL, materials=[wool])
camera = hg.Camera(480, 360, (700.0, 700.0), (240.0, 180.0)).look_at((0.05, -0.25, 0.1), (0.048, 0.048, 0.048))

view = hg.Preview(seconds=0.1)  # it keeps the box and the shadow maps, and learns how many rays come in time
for turn in np.linspace(0.0, 2.0, 8):
    lamp = hg.Lamp(position=(0.5 * np.sin(turn), -0.5 * np.cos(turn), 0.4))
    scene, start = hg.Scene(camera, (lamp,), (box,)), time.perf_counter()
    image = next(view.pictures(scene))  # a viewer takes the next ones too, until something moves again
    height, width = image.alpha.shape
    print(f"lamp at {turn:.1f} rad: {width} × {height} pixels after {1e3 * (time.perf_counter() - start):.0f} ms")

start = time.perf_counter()
for image in view.pictures(scene):
    level = image.metadata["preview"]
    print(f"stride {level['stride']}, {level['share']:.0%} of the work done after {time.perf_counter() - start:.2f} s")
print(*image.save(folder / "preview.exr", force=True))  # the same bits as hg.render(scene) gives
