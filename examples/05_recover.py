"""Photograph an object from all around by a simulated camera, and recover it as a volume box."""

from dataclasses import replace

import numpy as np

import hagoromo as hg

# A glazed figure of three balls, 8 cm high; α, β in 1/sr, γ in rad.
clay = hg.Reflectance(0.15, 1.0, 0.18, 1.5, body_colour=hg.Spectrum([400, 550, 700], [0.4, 0.8, 1.1]), name="clay")
balls = [((0.0, 0.0, -0.015), 0.025), ((0.0, 0.0, 0.02), 0.016), ((0.022, 0.0, 0.0), 0.01)]
figure = tuple(hg.Surface.sphere(centre, radius, clay) for centre, radius in balls)

# Eighteen views; in each a lamp at the camera's side.
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

recovered = hg.recover(hg.Capture(tuple(photographs), "figure"), hg.RecoverySettings(side=32, steps=40, keep=9))
print(recovered, f"gamma {recovered.gamma:.3f}")
for score in recovered.scores():
    print(f"{score.name}: {score.psnr:.1f} dB")
recovered.box(side=96).save("out/figure.zarr", force=True)
