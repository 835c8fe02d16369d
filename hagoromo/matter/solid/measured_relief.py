"""Measured relief: the folder that a measurement wrote → the surface and its materials, for a volume box."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.files.png import read_png
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.solid.relief import Relief
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.material.materials_file import read_materials
from hagoromo.reflectance.reflectance import Reflectance


def read_relief(folder: Path) -> tuple[Relief, tuple[MaterialEstimate, ...]]:
    """The relief in materials.json, labels.png, normals.exr, points.exr and, if there is one, body.exr; its materials.

    body.exr: α c_b of each pixel, a channel per camera channel, in the order of the file's names ("0", "1", … or
    R, G, B); without it each pixel has the colour of its material. Raises `InputError` where the files do not match.
    """
    materials = read_materials(folder / "materials.json")
    labels = read_png(folder / "labels.png").astype(np.int64) - 1
    normals, points = (_vectors(folder / f"{name}.exr", letter) for name, letter in (("normals", "N"), ("points", "P")))
    if labels.ndim != 2 or labels.max() >= len(materials):
        raise InputError(f"{folder / 'labels.png'} has labels up to {labels.max() + 1}: materials are {len(materials)}")
    colours = np.array([material.alpha * np.array(material.body_colour) for material in materials])
    body = np.where((labels >= 0)[..., None], colours[np.maximum(labels, 0)], 0.0)
    if (folder / "body.exr").is_file():
        layers, _ = read_exr(folder / "body.exr")
        values = {name for name in layers if "." not in name}  # not "error.R" and the like
        names = tuple("RGB") if values == set("RGB") else tuple(sorted(values))
        body = np.stack([layers[name] for name in names], axis=2).astype(np.float64)
    for name, part in (("normals", normals), ("points", points), ("body", body)):
        if part.shape[:2] != labels.shape or part.shape[2] != (3 if name != "body" else colours.shape[1]):
            raise InputError(f"{folder}: {name} of shape {part.shape} for labels of {labels.shape}: measure again")
    return Relief(points, normals, body, labels), materials


def surface_reflectances(
    materials: Sequence[MaterialEstimate], basis: Sequence[Spectrum], dim: float
) -> list[Reflectance]:
    """The materials with their body colours on `basis`, dimmed by `dim`, on plane elements."""
    reflectances = []
    for material in materials:
        values = np.maximum(np.sum([c * s.values for c, s in zip(material.body_colour, basis, strict=True)], axis=0), 0)
        colour = Spectrum(basis[0].wavelengths, values)
        weights = material.alpha * dim, material.beta * dim
        reflectances.append(Reflectance(*weights, material.gamma, material.n, colour, name=material.name))
    return reflectances


def _vectors(path: Path, letter: str) -> NDArray[np.float32]:
    layers, _ = read_exr(path)
    names = [f"{letter}.{axis}" for axis in "XYZ"]
    if not set(names) <= set(layers):
        raise InputError(f"{path} must have the channels {', '.join(names)}: it has {', '.join(layers)}")
    return np.stack([layers[name] for name in names], axis=2)
