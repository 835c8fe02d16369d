"""Kind "relief": the skin of a measured surface. measured: the folder of `measure`, with points.exr; camera: file of
cameras, whose first view saw it; dim: all reflectances are multiplied by it, lamps are to be as much stronger; response
and lamp: of the photographs.
"""

from __future__ import annotations

from dataclasses import replace

from hagoromo.camera.formats.camera_file import read_views
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import anything, number, table, text
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.recipes.recipe import Kind, Recipe
from hagoromo.matter.solid.measured_relief import read_relief, surface_reflectances
from hagoromo.matter.solid.relief import relief_plan
from hagoromo.reflectance.spectra.body_basis import body_basis
from hagoromo.volume.store.plan import BoxPlan


def _dim(value: object) -> float:
    if not 0.0 < number(value) <= 1.0:
        raise ValueError("a number above 0, 1 at most")
    return number(value)


def _plan(recipe: Recipe) -> BoxPlan:
    if recipe["resolution"] != 1.0:
        raise InputError(f"{recipe.where}: resolution is for other kinds: a relief has a voxel for each pixel")
    relief, materials = read_relief(recipe.file(recipe["measured"]))
    views = read_views(recipe.file(recipe["camera"]))
    camera = next(iter(views.values()))
    response = None if recipe["response"] is None else Response.load(recipe["response"], recipe.folder)
    basis = body_basis(response, Spectrum.load(recipe["lamp"], recipe.folder))
    reflectances = surface_reflectances(materials, basis, recipe["dim"])
    return relief_plan(replace(relief, body=recipe["dim"] * relief.body), camera, reflectances, basis)


KEYS = {
    "measured": text, "camera": text, "dim": (_dim, 1.0), "response": (text, None), "lamp": (anything, 1.0),
    "material": (table, {}),
}  # fmt: skip
KIND = Kind("plane", KEYS, _plan)
