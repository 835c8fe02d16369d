"""Recover an object from many views

A simulated camera photographs a figure from all around, with a lamp at its side. Shape, colours and gloss are recovered
as a volume box; two views are kept aside to test it.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## Eighteen photographs
#
# A glazed figure of three balls, 8 cm high; α, β in 1/sr, γ in rad.
clay = hg.Reflectance(0.15, 1.0, 0.18, 1.5, body_colour=hg.Spectrum([400, 550, 700], [0.4, 0.8, 1.1]), name="clay")
balls = [((0.0, 0.0, -0.015), 0.025), ((0.0, 0.0, 0.02), 0.016), ((0.022, 0.0, 0.0), 0.01)]
figure = tuple(hg.Surface.sphere(centre, radius, clay) for centre, radius in balls)

camera = hg.Camera(72, 72, focal=(380, 380), principal=(36, 36), response=hg.Response.load("canon_eos_300d"))
camera = replace(camera, sensor=hg.Camera.preset("canon_eos_kiss_digital").sensor)
photographs = []
for k in range(18):
    turn, height = 2.4 * k, 0.25 * np.cos(np.pi * (k + 0.5) / 18)
    eye = (0.4 * np.cos(turn), 0.4 * np.sin(turn), height)
    beside = (0.5 * np.cos(turn + 0.5), 0.5 * np.sin(turn + 0.5), 0.3)
    lamp = hg.Lamp(position=beside, spectrum=hg.Spectrum.named("D65"))
    scene = hg.Scene(camera.look_at(eye, (0.0, 0.0, 0.0)), (lamp,), surfaces=figure)
    (photograph,) = hg.simulate(scene, hg.Settings(seed=k)).photographs
    _, _, surface = hg.visible_shape(scene)
    photographs.append(replace(photograph, name=f"view {k}", silhouette=surface >= 0))

# %%
# ## Recovered
#
# A coarse grid and few steps, for a minute on one core: [`hagoromo recover`](../howto/recover.md) takes finer ones, and
# says where it errs.

recovered = hg.recover(hg.Capture(tuple(photographs), "figure"), hg.RecoverySettings(side=32, steps=40, keep=9))
print(recovered, f"gamma {recovered.gamma:.3f}")
for score in recovered.scores():
    print(f"{score.name}: {score.psnr:.1f} dB")

kept = [view for view in photographs if view.name in {score.name for score in recovered.scores()}]
figure, row = plt.subplots(1, 2 * len(kept), figsize=(11, 3), layout="constrained")
for number, photograph in enumerate(kept):
    light, covered = recovered.picture(photograph)
    bright = float(np.percentile(photograph.values, 99.5))
    pictures = {f"{photograph.name}: photograph": photograph.values, "recovered": light}
    for axes, (title, picture) in zip(row[2 * number :], pictures.items(), strict=False):
        axes.imshow(hg.srgb_encode(np.clip(picture / bright, 0.0, 1.0)))
        axes.set(title=title)
        axes.set_axis_off()
plt.show()

# %%
# ## A volume box, and its surface
#
# It can be rendered, sent round and exported as any other. The surface is compared with the truth.

box = recovered.box(side=96)
print(box)
mesh = recovered.mesh()
distances = [np.linalg.norm(mesh.vertices - np.array(centre), axis=1) - radius for centre, radius in balls]
nearest = np.min(distances, axis=0)
print(f"its surface is off by {1e3 * np.median(np.abs(nearest)):.2f} mm in the median, of a figure 80 mm high")
figure, axes = plt.subplots(figsize=(6, 2.8), layout="constrained")
axes.hist(1e3 * nearest, bins=[0.1 * k for k in range(-30, 31)])
axes.set(xlabel="distance from the true surface [mm], outside above 0", ylabel="vertices")
plt.show()
