"""A matter of one's own

A volume box is filled by a function of position: a cone of cloth with folds, whose threads run around it. It stands on
a floor under two lamps.
"""

import drjit as dr
import matplotlib.pyplot as plt

import hagoromo as hg

# %%
# ## A function of position
#
# It gets points [m] in the axes of the box, and gives the density, 0…1, and the direction of the fibres there. It is
# plain Dr.Jit, so that a box of any size is filled by all cores. α, β in 1/sr, γ in rad: [the reflection
# model](../model/reflection.md#s2).

SIDE, VOXEL = 0.128, 0.001  # [m]
indigo = hg.Spectrum([380, 450, 550, 610, 700], [0.3, 0.4, 0.2, 0.1, 0.25])
cloth = hg.Reflectance(0.3, 0.4, 0.37, 1.54, body_colour=indigo, element="cylinder", name="cloth")


def cone_with_folds(point):
    """Density and the direction of the threads."""
    x, y = point.x - SIDE / 2, point.y - SIDE / 2
    radius, angle = dr.sqrt(x * x + y * y + 1e-9), dr.atan2(y, x)
    surface = 0.055 * (1.0 - 0.75 * point.z / SIDE) * (1.0 + 0.1 * dr.cos(11.0 * angle))
    density = dr.fmin(dr.fmax(0.4 * (surface - radius) / VOXEL + 0.5, 0.0), 1.0)
    return density, type(point)(-y / radius, x / radius, 0.0 * x)


box = hg.VolumeBox.from_field(cone_with_folds, (128, 128, 128), VOXEL, tau=1.0 / VOXEL, materials=[cloth])
print(box)

# %%
# ## In a scene

grey = hg.Reflectance(0.04, 1.5, 0.2, 1.5, body_colour=hg.Spectrum.constant(1.0), name="floor")
white = hg.Spectrum.named("D65")
scene = hg.Scene(
    camera=hg.Camera.preset("canon_eos_kiss_digital", binning=8).look_at((0.4, -0.5, 0.3), (0.06, 0.06, 0.05)),
    lamps=(hg.Lamp(position=(-0.4, -0.5, 0.7), spectrum=white), hg.Lamp(position=(0.8, 0.7, 0.5), spectrum=white)),
    boxes=(box,),
    surfaces=(hg.Surface.floor(0.0, 2.0, grey),),
)
image = hg.render(scene, hg.Settings(samples=2))
print(*image.save("image.exr", scene.camera.response, force=True))

figure, axes = plt.subplots(figsize=(7, 4.6), layout="constrained")
axes.imshow(image.display())
axes.set_axis_off()
axes.set_title("a cone of cloth with folds")
plt.show()

# %%
# ## The direction of the fibres matters
#
# The same density with threads that run down the folds instead: light and shade fall otherwise. A kind of matter that
# recipes may name takes one entry point more: [add a matter](../architecture.md#add-a-matter).


def threads_down(point):
    """The same density, and upright threads."""
    density, _ = cone_with_folds(point)
    return density, type(point)(0.0 * point.x, 0.0 * point.x, 1.0 + 0.0 * point.x)


other = hg.VolumeBox.from_field(threads_down, (128, 128, 128), VOXEL, tau=1.0 / VOXEL, materials=[cloth])
figure, row = plt.subplots(1, 2, figsize=(8, 3.8), layout="constrained")
close = hg.Camera(300, 300, (900.0, 900.0), (150.0, 150.0)).look_at((0.4, -0.5, 0.3), (0.064, 0.064, 0.06))
for axes, one, title in zip(row, (box, other), ("threads around", "threads down"), strict=True):
    picture = hg.render(hg.Scene(close, scene.lamps, (one,), scene.surfaces), hg.Settings(samples=2))
    axes.imshow(picture.display(exposure=7.0))
    axes.set(title=title)
    axes.set_axis_off()
plt.show()
