"""All orders of light, three ways

White, dense matter sends light on many times before it comes out. The march sees light that was scattered once; modes
full and path see all of it: solved on a grid and mended by random walks, or walked alone.
"""

import time
from typing import Literal

import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## A white, lumpy ball
#
# White grains, so dense that hardly any light passes straight through.

SIDE, VOXEL = 32, 0.002  # voxels, [m]
z, y, x = (np.mgrid[:SIDE, :SIDE, :SIDE] + 0.5 - SIDE / 2) * VOXEL
radius = np.sqrt(x**2 + y**2 + z**2)
surface = 0.024 + 0.003 * np.sin(150.0 * x) * np.sin(150.0 * y) * np.sin(150.0 * z)
density = np.clip((surface - radius) / VOXEL + 0.5, 0.0, 1.0)
grains = hg.Reflectance(0.24, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element="sphere", name="grains")
box = hg.VolumeBox.from_arrays(
    density, np.zeros((*density.shape, 3)), VOXEL, 500.0, [grains], extinction="projected", name="lumps"
)
middle = (SIDE * VOXEL / 2,) * 3
camera = hg.Camera(96, 96, (170.0, 170.0), (48.0, 48.0)).look_at((0.032, -0.1, 0.06), middle)
scene = hg.Scene(
    camera, (hg.Lamp(to_lamp=(-0.7, -0.5, 0.6), intensity=np.pi, spectrum=hg.Spectrum.named("D65")),), (box,)
)

# %%
# ## Three modes
#
# Seconds are of the processor; mode path has noise, which falls with the square root of the walks. Brightness is Y, 1
# for a white diffuser that faces the lamp.

modes: tuple[Literal["march", "full", "path"], ...] = ("march", "full", "path")
images = {}
for mode in modes:
    begun = time.process_time()
    images[mode] = hg.render(scene, hg.Settings(samples=128 if mode == "path" else 4), mode=mode)
    took = time.process_time() - begun
    light = images[mode].xyz()[..., 1][images[mode].alpha > 0.99].mean()
    print(f"{mode:6} mean Y {light:.3f}   {took:.1f} s")
stated = images["full"].full_error
assert stated is not None and stated.mended is not None
low, high = stated.mended.mean_interval
print(f"full states that its mean is off by {100 * low:.2f} to {100 * high:.2f} %,")
print(f"and blocks of 8 × 8 pixels by {100 * stated.mended.blocks:.1f} %")

figure, row = plt.subplots(1, 3, figsize=(10, 3.6), layout="constrained")
for axes, (mode, image) in zip(row, images.items(), strict=True):
    axes.imshow(image.display(exposure=2.0))
    axes.set_title(mode)
    axes.set_axis_off()
plt.show()

# %%
# ## Along a line through the middle
#
# Light of higher orders fills the hollows and the side that is turned away from the lamp: that is why skin, cloth and
# snow look soft. [All orders](../orders.md) measures what this does to a measured colour.

figure, axes = plt.subplots(figsize=(8, 3), layout="constrained")
for mode, image in images.items():
    axes.plot(image.xyz()[48, :, 1], label=mode, linewidth=0.8 if mode == "path" else 1.6)
axes.set(xlabel="column of the picture [px]", ylabel="brightness Y")
axes.legend()
plt.show()
