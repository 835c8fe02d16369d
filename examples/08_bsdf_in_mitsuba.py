"""Our reflectance as a BSDF in Mitsuba

A material goes to Mitsuba as its plugin `hagoromo`. Both renderers see the same ball under the same lamp, and their
pictures are compared.
"""

import drjit as dr
import matplotlib.pyplot as plt
import mitsuba as mi
import numpy as np

import hagoromo as hg
import hagoromo_formats.mitsuba as hm

# %%
# ## The scene, here and there
#
# `write_mitsuba` writes a scene as XML; `load_into_mitsuba` does it without a folder. The variant is `mono`: one even
# wavelength, whose radiance is that of our weights. [All that goes over, and what is lost](../howto/mitsuba.md).

silk = hg.Reflectance(0.2, 0.3, 0.25, 1.5, hg.Spectrum.constant(0.6), name="silk")
ball = hg.Surface.sphere((0.0, 0.0, 0.0), 0.05, silk)
camera = hg.Camera(160, 160, (640.0, 640.0), (80.0, 80.0)).look_at((0.0, -0.5, 0.0), (0.0, 0.0, 0.0))
scene = hg.Scene(camera, (hg.Lamp(to_lamp=(-0.5, -0.7, 0.5), intensity=2.0),), surfaces=(ball,))
ours = hg.render(scene, hg.Settings(samples=64))

mi.set_variant("llvm_ad_mono")
hm.register()
theirs = np.array(mi.render(hm.load_into_mitsuba(scene), spp=512))[..., 0]

# %%
# ## The pictures
#
# The radiance of a picture of ours is the sum of its weights, each times its colour: 0.6 of the body, 1 of the
# interface.

here = ours.weights @ np.array([0.6, 1.0], np.float32)
inside = ours.alpha > 0.99
off = here[inside] / np.maximum(theirs[inside], 1e-6) - 1.0
lit = here[inside] > 0.02 * here.max()
print(f"mean radiance: here {here[inside].mean():.5f}, there {theirs[inside].mean():.5f}")
print(f"where the ball is lit, the two differ by {100 * np.sqrt(np.mean(off[lit] ** 2)):.2f} % (rms)")

figure, row = plt.subplots(1, 3, figsize=(10, 3.2), layout="constrained")
for axes, picture, title in zip(row, (here, theirs), ("Hagoromo", "Mitsuba"), strict=False):
    shown = axes.imshow(picture, cmap="gray", vmin=0.0, vmax=float(np.percentile(here, 99.9)))
    axes.set(title=title)
    axes.set_axis_off()
figure.colorbar(shown, ax=row[1], label="radiance")
difference = np.where(inside & (here > 0.02 * here.max()), 100.0 * (here / np.maximum(theirs, 1e-6) - 1.0), np.nan)
shown = row[2].imshow(difference, cmap="RdBu_r", vmin=-2.0, vmax=2.0)
row[2].set(title="difference, where lit")
row[2].set_axis_off()
figure.colorbar(shown, ax=row[2], label="here over there − 1 [%]")
plt.show()

# %%
# ## Single directions
#
# The plugin against [`Reflectance.evaluate`](../reference/api/reflectance.md#hagoromo.Reflectance), a thousand pairs of
# directions at once.

random = np.random.default_rng(0)
ways = random.normal(size=(2, 1000, 3))
ways[..., 2] = np.abs(ways[..., 2])
to_lamp, to_eye = ways / np.linalg.norm(ways, axis=2, keepdims=True)
at = dr.zeros(mi.SurfaceInteraction3f, 1000)
at.wi = mi.Vector3f(to_eye.T.astype(np.float32))
plugin = np.array(mi.load_dict(hm.bsdf(silk)).eval(mi.BSDFContext(), at, mi.Vector3f(to_lamp.T.astype(np.float32))))[0]
law = silk.evaluate([0, 0, 1], to_lamp, to_eye)[:, 0]
print(f"largest difference: {np.abs(plugin - law).max():.1e} 1/sr, of values up to {law.max():.2f} 1/sr")
