"""Kind "relief": the skin of a measured surface. measured: the folder of `measure`, with points.exr; camera: file of
cameras, whose first view saw it; dim: all reflectances are multiplied by it, lamps are to be as much stronger; response
and lamp: of the photographs.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Annotated, Any

from msgspec import Meta

from hagoromo.camera.formats.camera_file import read_views
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import about
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.matter.recipe import Kind, Recipe, RecipeTable
from hagoromo.matter.relief.relief import read_relief, relief_plan, surface_reflectances
from hagoromo.reflectance.spectra.body_basis import body_basis
from hagoromo.volume.store.plan import BoxPlan


class ReliefTable(RecipeTable, frozen=True, kw_only=True):
    """The skin of a measured surface."""

    material: Annotated[dict[str, Any], about("not used: the materials are the measured ones")] = {}
    measured: Annotated[str, about("folder of `measure`, with points.exr")]
    camera: Annotated[str, about("file of cameras, of which the first photographed it")]
    dim: Annotated[
        float, Meta(gt=0, le=1), about("factor that makes reflectances conserve energy; lamps are divided by it")
    ] = 1.0
    response: Annotated[str | None, about("camera response of the photographs: a name or a CSV file")] = None
    lamp: Annotated[Any, SOURCE, about("spectrum of the lamps of the photographs")] = 1.0


def _plan(recipe: Recipe[ReliefTable]) -> BoxPlan:
    table = recipe.table
    if table.resolution != 1.0:
        raise InputError(f"{recipe.where}: resolution is for other kinds: a relief has a voxel for each pixel")
    relief, materials = read_relief(recipe.file(table.measured))
    views = read_views(recipe.file(table.camera))
    camera = next(iter(views.values()))
    response = None if table.response is None else Response.load(table.response, recipe.folder)
    basis = body_basis(response, Spectrum.load(table.lamp, recipe.folder))
    reflectances = surface_reflectances(materials, basis, table.dim)
    return relief_plan(replace(relief, body=table.dim * relief.body), camera, reflectances, basis)


KIND = Kind("plane", ReliefTable, _plan)
