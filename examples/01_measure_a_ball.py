"""Photograph a ball by a simulated camera under three lamps, and measure its reflectance from the photographs."""

import hagoromo as hg

# A glazed ball of 6 cm; α, β in 1/sr, γ in rad.
glaze = hg.Reflectance(0.10, 1.5, 0.18, 1.5, body_colour=hg.Spectrum([400, 550, 700], [0.4, 0.9, 1.3]), name="glaze")
ball = hg.Surface.sphere((0.0, 0.0, 0.0), 0.03, glaze)

# The camera stands 0.4 m before it; the lamps deviate light by little, more and much, which tells the refractive index.
camera = hg.Camera.preset("canon_eos_kiss_digital", binning=8).look_at(eye=(0.0, -0.4, 0.0), target=(0.0, 0.0, 0.0))
white = hg.Spectrum.named("D65")
lamps = [hg.Lamp(position=place, spectrum=white) for place in ((0.2, -0.8, 0.3), (0.0, -0.2, 0.9), (0.0, 0.4, -0.8))]

capture = hg.simulate(hg.Scene(camera, tuple(lamps), surfaces=(ball,)), name="ball")
material = hg.measure(capture).materials[0]

# A measured body colour has a mean of 1 over the channels, so alpha is that of the glaze times its mean colour.
for name in ("alpha", "beta", "gamma", "n"):
    low, high = material.interval_95[name]
    print(f"{name:6} {getattr(material, name):.5f}   95 % interval {low:.5f} … {high:.5f}")
