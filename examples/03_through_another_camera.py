"""Expose one rendering through two cameras under two lamp spectra: eq. (10), and nothing is rendered again."""

import hagoromo as hg

green = hg.Spectrum([380, 480, 530, 580, 680, 780], [0.05, 0.2, 0.6, 0.2, 0.1, 0.5])
leaf = hg.Reflectance(0.25, 0.5, 0.25, 1.45, body_colour=green, name="leaf")
scene = hg.Scene(
    camera=hg.Camera.preset("canon_eos_kiss_digital", binning=16).look_at((0.0, -0.5, 0.0), (0.0, 0.0, 0.0)),
    lamps=(hg.Lamp(position=(-0.5, -0.8, 0.6), spectrum=hg.Spectrum.named("D65")),),
    surfaces=(hg.Surface.sphere((0.0, 0.0, 0.0), 0.05, leaf),),
)
image = hg.render(scene)  # geometric weights of body and interface: no colour yet

for camera in ("canon_eos_300d", "Nikon 5100 (NPL)"):
    response = hg.Response.load(camera)
    for lamp in ("D65", "A"):
        rgb = image.expose(response, lamps=[hg.Spectrum.named(lamp)])
        mean = rgb[image.alpha > 0.5].mean(axis=0)
        print(f"{camera:17} under {lamp:3}: R/G = {mean[0] / mean[1]:.3f}, B/G = {mean[2] / mean[1]:.3f}")
