"""Measured relief: the surface and the materials in the folder of a measurement, ready to be filled with matter.

Gloss classes: β, γ and tail of every pixel as a few materials, as each voxel of a box has the number of one.

Pixels of a material are cut in two by ln β, ln γ or 1/ν, whichever differs more, again and again, as Heckbert (1982)
cuts colours. A class has the mean of its pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.relief.relief import Relief
from hagoromo.measurement.gloss.gloss_map import GLOSS_CHANNELS, TAIL_CHANNELS
from hagoromo.measurement.measured_surface import read_surface
from hagoromo.measurement.measurement_files import read_maps
from hagoromo.reflectance.facets import GAUSSIAN, LEAST_NU
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.reflectance import NEUTRAL, Reflectance
from hagoromo.volume.bricks import MATERIALS

CLASSES = 32  # of a material, at most
LEAST_SPREAD = 0.02  # standard deviation of ln β, of ln γ and of 1/ν within a class that is not cut
LEAST_TAIL = 1e-3  # 1/ν below which facets count as Gaussian
Array = NDArray[np.float64]


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
        reflectances.append(material.with_spectra(*colours, factor=dim))
    return reflectances


def _on_basis(colour: Sequence[float], basis: Sequence[Spectrum]) -> Spectrum:
    """The spectrum Σ colour_c B_c, 0 where that is negative."""
    values = np.sum([c * s.values for c, s in zip(colour, basis, strict=True)], axis=0)
    return Spectrum(basis[0].wavelengths, np.maximum(values, 0.0))


def with_gloss_classes(
    labels: NDArray[np.integer],
    materials: Sequence[MaterialEstimate],
    beta: NDArray,
    gamma: NDArray,
    nu: NDArray | None = None,
) -> tuple[NDArray[np.integer], tuple[MaterialEstimate, ...]]:
    """Labels (h, w) and materials with those of the classes added; where β and γ (h, w) are not above 0, as they were.

    No more than a box can have: MATERIALS. nu: (h, w) of the tails, 0 for Gaussian facets; None: that of the materials.
    """
    known = (beta > 0.0) & (gamma > 0.0) & (labels >= 0)
    varied = [number for number in range(len(materials)) if (known & (labels == number)).any()]
    most = min(CLASSES, (MATERIALS - len(materials)) // max(len(varied), 1))
    found, all_materials = labels.copy(), list(materials)
    for number in varied:
        mine = known & (labels == number)
        gloss = np.log(np.stack([beta[mine], gamma[mine]], axis=1).astype(np.float64))
        if nu is not None:
            gloss = np.c_[gloss, np.where(nu[mine] > 0.0, 1.0 / np.maximum(nu[mine], LEAST_NU), 0.0)]
        classes = gloss_classes(gloss, most)
        found[mine] = len(all_materials) + classes
        for one in range(int(classes.max(initial=-1)) + 1):
            mean = gloss[classes == one].mean(axis=0)
            mean_beta, mean_gamma = np.exp(mean[:2]).tolist()
            name = f"{materials[number].name}, gloss {one + 1}"
            own = materials[number].with_gloss(mean_beta, mean_gamma, None if nu is None else nu_of(float(mean[2])))
            all_materials.append(replace(own, name=name))
    return found, tuple(all_materials)


def nu_of(tail: float) -> float:
    """ν of a tail 1/ν; Gaussian facets where that is next to 0."""
    return GAUSSIAN if tail < LEAST_TAIL else 1.0 / tail


def gloss_classes(gloss: Array, most: int) -> NDArray[np.intp]:
    """(P,) classes 0, 1, … of rows (P, G) of ln β, ln γ …: `most` at most, fewer where all are narrow."""
    classes = np.zeros(len(gloss), np.intp)
    for new in range(1, most):
        spreads = [len(part) * part.var(axis=0) for part in (gloss[classes == one] for one in range(new))]
        wide = [
            np.where(spread > np.count_nonzero(classes == one) * LEAST_SPREAD**2, spread, 0.0)
            for one, spread in enumerate(spreads)
        ]
        cut, axis = np.unravel_index(int(np.argmax(wide)), (new, gloss.shape[1]))
        if wide[int(cut)][axis] == 0.0:
            break
        column = gloss[:, axis]
        classes[(classes == cut) & (column > column[classes == cut].mean())] = new
    return classes
