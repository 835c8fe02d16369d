"""Higher orders: what modes path and full have in common — which matter they take, and what it sends on at most."""

from __future__ import annotations

import math
import warnings

import numpy as np

from hagoromo.errors import InputError
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_palette import reflectances_of
from hagoromo.image.scene.surface import Surface
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.path.bands import COUNTS, Bands
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.voxels import unpacked_density

LARGEST_ALBEDO = 1.002  # of voxels, whose colours are halves
BRICKS_READ = 1 << 10  # at once
BANDS_ERROR = 0.02  # of bands, above which a picture warns


def albedos_of(scene: Scene) -> list[Spectrum]:
    """About the share of light of each wavelength that bodies and interfaces of a scene reflect."""
    tints = [surface.reflectance.interface_colour for surface in scene.surfaces if surface.optics]
    tints += [through(surface) for surface in scene.surfaces if surface.absorption is not None]
    for surface in scene.surfaces:
        purest = surface.body_texture.purest() if surface.body_texture else []
        shown = [surface.reflectance.shown(colour) for colour in purest]
        tints += [Spectrum(s.wavelengths, math.pi * surface.reflectance.alpha * s.values) for s in shown]
    return albedos(reflectances_of(scene), [spectrum for box in scene.boxes for spectrum in box.basis]) + tints


def through(surface: Surface) -> Spectrum:
    """Share of light that passes straight through the whole length of a glass that absorbs."""
    assert surface.absorption is not None
    length = float(np.ptp(surface.corners(), axis=0).max())
    wavelengths = np.arange(400.0, 701.0, 1.0)
    return Spectrum(wavelengths, np.exp(-length * surface.absorption.at(wavelengths)))


def albedos(reflectances: list[Reflectance], basis: list[Spectrum]) -> list[Spectrum]:
    """What bodies and interfaces send on, and elements let through, of the light of each wavelength, about; basis: of
    the colours of voxels.
    """
    most = max(r.alpha for r in reflectances)
    scaled = [(math.pi * r.alpha, r.shown_body_colour) for r in reflectances] + [(math.pi * most, s) for s in basis]
    scaled += [(r.interface_albedo, r.interface_colour) for r in reflectances]
    scaled += [(r.transmission, r.transmitted[0]) for r in reflectances if r.transmits]
    return [Spectrum(s.wavelengths, factor * s.values) for factor, s in scaled]


def warn_of_few_bands(bands: Bands) -> None:
    """Warn where light of higher orders has too few bands for the spectra of a scene."""
    if bands.error > BANDS_ERROR:
        warnings.warn(
            f"{bands.count} bands are too few for the spectra of this scene: the colour of higher orders is off by up "
            f"to {bands.error:.1%} of white's light; mode path takes up to {COUNTS[-1]}, smoother spectra need fewer",
            stacklevel=3,
        )


def check_matter(box: VolumeBox) -> None:
    """`InputError` for a box whose light of all orders is not computed."""
    elements = sorted({material.element for material in box.materials} - {"sphere"})
    if box.extinction == "isotropic" and elements:
        raise InputError(
            f"volume box {box.name!r} has isotropic extinction, by which a {elements[0]} that is lit again sends back "
            'more light than it takes: set extinction = "projected"'
        )
    if box.basis and (albedo := largest_albedo(box)) > LARGEST_ALBEDO:
        raise InputError(
            f"volume box {box.name!r}: its voxels send back up to {albedo:.3g} of the light at some wavelength: lower "
            "their body colours, or alpha"
        )


def largest_albedo(box: VolumeBox) -> float:
    """Largest albedo of the body colours of a box's voxels, with the largest α of its materials and their interface."""
    knots = [spectrum.wavelengths for spectrum in box.basis]  # between which a spectrum is linear
    wavelengths = np.unique(np.clip(np.concatenate(knots), 400.0, 700.0))
    basis = np.array([spectrum.at(wavelengths) for spectrum in box.basis], np.float32)
    bricks, brightest = box.bricks, 0.0
    assert bricks.colour is not None
    for begin in range(0, bricks.kept, BRICKS_READ):
        read = begin, min(begin + BRICKS_READ, bricks.kept)
        matter = unpacked_density(np.array(bricks.density.read(*read))).ravel() > 0.0
        colours = np.array(bricks.colour.read(*read)).reshape(-1, 4)[matter, : len(basis)].astype(np.float32)
        brightest = max([brightest, *(float((colours @ each).max(initial=0.0)) for each in basis.T)])
    sent = [(math.pi * m.alpha * brightest, m.interface_albedo, m.transmitted_albedo().max()) for m in box.materials]
    return max(sum(parts) for parts in sent)
