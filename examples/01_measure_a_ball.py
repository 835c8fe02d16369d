"""Measure a ball, and see how surely

A simulated camera photographs a glazed ball under three lamps. Its reflectance is measured from the photographs, with
95 % intervals, and compared with the truth.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## Photographs
#
# The ball is 6 cm wide. Its body (diffuse) sends back α [1/sr], its interface (specular) β [1/sr] with facets tilted by
# γ [rad]: [the reflection model](../model/reflection.md#s2). The lamps deviate light by little, more and much, which
# determines the refractive index n.

glaze = hg.Reflectance(0.10, 1.5, 0.18, 1.5, body_colour=hg.Spectrum([400, 550, 700], [0.4, 0.9, 1.3]), name="glaze")
ball = hg.Surface.sphere((0.0, 0.0, 0.0), 0.03, glaze)
camera = hg.Camera.preset("canon_eos_kiss_digital", binning=8).look_at(eye=(0.0, -0.4, 0.0), target=(0.0, 0.0, 0.0))
white = hg.Spectrum.named("D65")
places = {"near the camera": (0.2, -0.8, 0.3), "above": (0.0, -0.2, 0.9), "behind": (0.0, 0.4, -0.8)}
lamps = [hg.Lamp(position=place, spectrum=white, name=name) for name, place in places.items()]
capture = hg.simulate(hg.Scene(camera, tuple(lamps), surfaces=(ball,)), name="ball")

figure, row = plt.subplots(1, 3, figsize=(9, 2.6), layout="constrained")
middle = np.s_[capture.photographs[0].values.shape[0] // 6 : -capture.photographs[0].values.shape[0] // 6]
brightest = max(float(np.percentile(one.values, 99.0)) for one in capture.photographs)
for axes, photograph in zip(row, capture.photographs, strict=True):
    axes.imshow(hg.srgb_encode(np.clip(photograph.values[middle] / brightest, 0.0, 1.0)))
    axes.set_title(f"lamp {photograph.lamps[0].name}")
    axes.set_axis_off()
plt.show()

# %%
# ## The measurement
#
# A measured body colour has a mean of 1 over the channels, so α is that of the glaze times its mean colour.

material = hg.measure(capture).materials[0]
for name in ("alpha", "beta", "gamma", "n"):
    low, high = material.interval_95[name]
    print(f"{name:6} {getattr(material, name):.5f}   95 % interval {low:.5f} … {high:.5f}")

# %%
# ## Fewer lamps, wider intervals
#
# With the lamp behind left out, no light is deviated by much: n and β trade against each other, and the intervals say
# so. Each is drawn relative to the truth; α is left out, whose truth depends on the camera's channels. An interval may
# miss the truth once in twenty times; β and n are correlated, so that they miss together.

fewer = replace(capture, photographs=capture.photographs[:2])
found = {"three lamps": material, "two lamps": hg.measure(fewer).materials[0]}
truth = {"beta": glaze.beta, "gamma": glaze.gamma, "n": glaze.n}
signs = {"beta": "β", "gamma": "γ", "n": "n"}
figure, axes = plt.subplots(figsize=(7, 2.8), layout="constrained")
for shift, (lamps_used, estimate) in zip((-0.12, 0.12), found.items(), strict=True):
    value = np.array([getattr(estimate, name) / truth[name] for name in truth])
    limits = np.array([estimate.interval_95[name] for name in truth]).T / np.array(list(truth.values()))
    off = 100.0 * (value - 1.0), np.abs(100.0 * (limits - value))
    axes.errorbar(off[0], np.arange(3) + shift, xerr=off[1], fmt="o", capsize=4, label=lamps_used)
axes.axvline(0.0, color="grey", linewidth=1)
axes.set_yticks(range(3), [signs[name] for name in truth])
axes.set(xlabel="measured value relative to the truth [%]", title="95 % intervals")
axes.legend()
plt.show()
