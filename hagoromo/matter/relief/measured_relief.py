"""Measured relief: the surface and the materials in the folder of a measurement, ready to be filled with matter."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.relief.gloss_classes import with_gloss_classes
from hagoromo.matter.relief.relief import Relief
from hagoromo.measurement.measured_surface import read_surface
from hagoromo.measurement.measurement_files import GLOSS_CHANNELS, TAIL_CHANNELS, read_maps
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.reflectance import NEUTRAL, Reflectance


def read_relief(folder: Path) -> tuple[Relief, tuple[MaterialEstimate, ...]]:
    """The relief in the folder of a measurement, and its materials; see `read_surface` for the files.

    Without body.exr each pixel has the colour of its material. Where gloss.exr has the gloss of each pixel, it is in
    materials of its own (`gloss_classes`), after those of the measurement. `InputError` where the files do not go
    together.
    """
    surface = read_surface(folder)
    if surface.points is None:
        raise InputError(f"{folder / 'points.exr'} does not exist: measure again")
    body = None if surface.body is None else surface.body.astype(np.float64)
    if body is None:
        colours = np.array([material.alpha * np.array(material.body_colour) for material in surface.materials])
        body = np.where((surface.labels >= 0)[..., None], colours[np.maximum(surface.labels, 0)], 0.0)
    labels, materials = surface.labels, surface.materials
    path = inside(folder, "gloss.exr")
    maps = read_maps(path, GLOSS_CHANNELS[:2], surface)
    if maps is not None:
        tails = read_maps(path, TAIL_CHANNELS[:1], surface, optional=True) or ()
        labels, materials = with_gloss_classes(labels, materials, *maps, *tails)
    return Relief(surface.points, surface.normals, body, labels, surface.labels), materials


def surface_reflectances(
    materials: Sequence[MaterialEstimate], basis: Sequence[Spectrum], dim: float
) -> list[Reflectance]:
    """The materials on plane elements, their colours on `basis` and their weights times `dim`."""
    reflectances = []
    for material in materials:
        coloured = len(set(material.interface_colour)) > 1  # otherwise it has the lamp's colour
        interface = _on_basis(material.interface_colour, basis) if coloured else NEUTRAL
        colours = _on_basis(material.body_colour, basis), interface
        weights, shape = (material.alpha * dim, material.beta * dim), (material.gamma, material.n)
        lobes = tuple((beta * dim, gamma) for beta, gamma in material.lobes)
        law = material.body_law.body_departures
        made = Reflectance(*weights, *shape, *colours, "plane", material.name, material.nu, lobes, **law)
        reflectances.append(made)
    return reflectances


def _on_basis(colour: Sequence[float], basis: Sequence[Spectrum]) -> Spectrum:
    """The spectrum Σ colour_c B_c, 0 where that is negative."""
    values = np.sum([c * s.values for c, s in zip(colour, basis, strict=True)], axis=0)
    return Spectrum(basis[0].wavelengths, np.maximum(values, 0.0))
