"""Preview while a lamp moves

A first picture of every scene in a third of a second, and of the last one all finer ones up to the render, with the
same bits.
"""

import time

import drjit as dr
import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## A ball of wool

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

# %%
# ## The lamp turns
#
# A [`Preview`](../reference/api/image.md#hagoromo.Preview) keeps what has not changed, here the box, and learns how
# many rays come in time: the picture of a slow moment is coarser. Times are of the machine that built this page, on one
# core.

view = hg.Preview(seconds=0.3)  # it keeps the box and the shadow maps, and learns how many rays come in time
first = []
for turn in np.linspace(0.0, 2.0, 8):
    lamp = hg.Lamp(position=(0.5 * np.sin(turn), -0.5 * np.cos(turn), 0.4))
    scene, start = hg.Scene(camera, (lamp,), (box,)), time.perf_counter()
    image = next(view.pictures(scene))  # a viewer takes the next ones too, until something moves again
    height, width = image.alpha.shape
    first.append((turn, image))
    print(f"lamp at {turn:.1f} rad: {width} × {height} pixels after {1e3 * (time.perf_counter() - start):.0f} ms")


figure, row = plt.subplots(1, 4, figsize=(11, 2.5), layout="constrained")
for axes, (turn, image) in zip(row, first[1::2], strict=True):
    axes.imshow(image.display(exposure=6.0))
    axes.set_title(f"{turn:.1f} rad: {image.alpha.shape[1]} × {image.alpha.shape[0]}")
    axes.set_axis_off()
plt.show()

# %%
# ## It stops
#
# Every further picture is finer; the last is what `hg.render(scene)` gives, to the bit.

start, finer = time.perf_counter(), []
for image in view.pictures(scene):
    level = image.metadata["preview"]
    finer.append(image)
    print(f"stride {level['stride']}, {level['share']:.0%} of the work done after {time.perf_counter() - start:.2f} s")
print("the same bits:", np.array_equal(finer[-1].weights, hg.render(scene).weights))

figure, row = plt.subplots(1, len(finer), figsize=(4.5 * len(finer), 3.2), layout="constrained", squeeze=False)
for axes, image in zip(row[0], finer, strict=True):
    axes.imshow(image.display(exposure=6.0))
    axes.set_title(f"stride {image.metadata['preview']['stride']}")
    axes.set_axis_off()
plt.show()
