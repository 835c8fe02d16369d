"""Spectra of skin from a camera's colours

What three channels of a camera say about the spectrum of skin, under one lamp and under two: the reflectance at each
wavelength with its 95 % band, which class of surfaces it is, and its colour under a third lamp.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## Three places of an arm
#
# Skin by its pigments: melanin in the epidermis, blood in the dermis. The camera reads them beside a white patch, with
# an error of 0.4 %.

PLACES = {"pale": (0.02, 0.012, 0.75), "flushed": (0.02, 0.045, 0.9), "tanned": (0.07, 0.02, 0.7)}
truth = {name: hg.skin_colour(hg.Pigment(*pigment)) for name, pigment in PLACES.items()}
camera = hg.Response.load("Nikon 5100 (NPL)")
random = np.random.default_rng(0)


def reading(spectrum, lamp):
    """What the camera reads under a lamp, over what it reads of white."""
    light = hg.Spectrum.named(lamp)
    exact = hg.camera_response(spectrum, light, camera) / hg.camera_white(light, camera)
    error = 0.004 * exact
    return hg.Reading(exact + error * random.standard_normal(3), error, light, camera)


# %%
# ## Spectra with bands
#
# Three numbers leave most of a spectrum free. What fills it is what is known of surfaces: measured ones, and skin as
# its optics allow it. A second lamp narrows the band.

priors = [hg.ReflectancePrior.load(name) for name in ("surfaces", "smooth", "skin")]
nm = np.arange(400.0, 701.0, 5.0)
figure, row = plt.subplots(1, 3, figsize=(11, 3.4), layout="constrained", sharey=True)
for axes, (name, spectrum) in zip(row, truth.items(), strict=True):
    for lamps in (("D65",), ("D65", "A")):
        found = hg.reflectance_spectrum([reading(spectrum, lamp) for lamp in lamps], priors)
        low, high = found.band_95
        inside = (found.wavelengths >= 400.0) & (found.wavelengths <= 700.0)
        label = " and ".join(lamps)
        axes.fill_between(found.wavelengths[inside], low[inside], high[inside], alpha=0.35, label=f"{label}: 95 % band")
        real = spectrum.at(found.wavelengths)
        held = np.mean(((real >= low) & (real <= high))[inside])
        width = np.mean((high - low)[inside])
        skin = found.probability["skin"]
        print(f"{name:8} {label:9} skin {skin:.2f}   mean width {width:.3f}   holds {100 * held:3.0f} % of the truth")
    axes.plot(nm, spectrum.at(nm), color="black", linewidth=1.2, label="truth")
    axes.set(title=name, xlabel="wavelength [nm]")
row[0].set_ylabel("reflectance")
row[0].legend(fontsize="small")
plt.show()

# %%
# ## Its colour under a lamp that was not there
#
# ΔE00 between two places, under a fluorescent tube:
# [`spectrum_difference`](../reference/api/image.md#hagoromo.spectrum_difference) carries the covariance on. The command
# for all this, from photographs with a chart, is [`hagoromo spectra`](../tutorial_skin.md).

tube = hg.Spectrum.named("FL11")
pale, flushed = (
    hg.reflectance_spectrum([reading(truth[name], lamp) for lamp in ("D65", "A")], priors)
    for name in ("pale", "flushed")
)
off, low, high = hg.spectrum_difference(pale, flushed, tube)
values = truth["pale"].held(360.0, 830.0).at(pale.wavelengths)
known = replace(pale, values=values, covariance=np.zeros_like(pale.covariance))
exact, _, _ = hg.spectrum_difference(known, truth["flushed"], tube)
print(f"ΔE00 of pale and flushed skin under FL11: {off:.1f}, 95 % interval {low:.1f} … {high:.1f}; truth {exact:.1f}")
