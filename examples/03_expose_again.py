"""Expose one rendering through other cameras and lamps

An image holds weights of geometry, no colours. What a camera reads under a lamp is a product of these weights with
spectra, exact and at once: nothing is rendered again.
"""

import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## One rendering

green = hg.Spectrum([380, 480, 530, 580, 680, 780], [0.05, 0.2, 0.6, 0.2, 0.1, 0.5])
leaf = hg.Reflectance(0.25, 0.5, 0.25, 1.45, body_colour=green, name="leaf")
camera = hg.Camera.preset("canon_eos_kiss_digital", binning=16).look_at((0.0, -0.5, 0.0), (0.0, 0.0, 0.0))
lamps = (
    hg.Lamp(position=(-0.5, -0.8, 0.6), spectrum=hg.Spectrum.named("D65"), name="key"),
    hg.Lamp(position=(0.9, -0.3, 0.1), spectrum=hg.Spectrum.named("D65"), intensity=0.3, name="fill"),
)
scene = hg.Scene(camera, lamps, surfaces=(hg.Surface.sphere((0.0, 0.0, 0.0), 0.05, leaf),))
image = hg.render(scene, hg.Settings(samples=4, separate_lamps=True))
print(image, image.lamp_names)

# %%
# ## Two cameras, three lamps
#
# Equation (10) of [§5](../model/colour.md#s5). The leaf reflects near 530 nm and above 700 nm; how red a camera sees it
# depends on its channels and on the lamp.

for name in ("canon_eos_300d", "Nikon 5100 (NPL)"):
    response = hg.Response.load(name)
    for lamp in ("D65", "A", "FL11"):
        rgb = image.expose(response, lamps=[hg.Spectrum.named(lamp)] * 2)
        mean = rgb[image.alpha > 0.5].mean(axis=0)
        print(f"{name:17} under {lamp:4}: R/G = {mean[0] / mean[1]:.3f}, B/G = {mean[2] / mean[1]:.3f}")

# %%
# ## Lamps of other strength and colour
#
# For a person's eye: the key lamp as it is, dimmed, and as a tungsten lamp beside a fill of daylight.

changes = {
    "as rendered": image,
    "key at a quarter": image.with_lamps(strength={"key": 0.25}),
    "key of tungsten": image.with_lamps(spectrum={"key": hg.Spectrum.named("A")}),
    "fill alone": image.with_lamps(strength={"key": 0.0}),
}
figure, row = plt.subplots(1, 4, figsize=(11, 2.9), layout="constrained")
for axes, (title, changed) in zip(row, changes.items(), strict=True):
    linear = hg.srgb_from_xyz(changed.xyz() / image.xyz()[..., 1].max())
    axes.imshow(hg.srgb_encode(np.clip(linear, 0.0, 1.0)))
    axes.set(title=title)
    axes.set_axis_off()
plt.show()
