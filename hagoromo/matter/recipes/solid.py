"""Kind "solid": [shape], or a mesh, of density 1; element plane."""

from __future__ import annotations

from hagoromo.files.record import table
from hagoromo.matter.recipes.form import form_keys, shape_of
from hagoromo.matter.recipes.recipe import Kind, Recipe, fineness_keys
from hagoromo.matter.solid.solid import MeshSurface, mesh_solid, solid
from hagoromo.volume.store.plan import BoxPlan


def _plan(recipe: Recipe) -> BoxPlan:
    where = f"{recipe.where} [shape]"
    key = form_keys(recipe["shape"], where)
    if key["form"] == "mesh":
        mesh = MeshSurface(recipe.file(key["file"]), key["height_mm"], key["rotation_deg"])
        return mesh_solid(mesh, recipe.material, recipe.fineness)
    return solid(*shape_of(recipe["shape"], where), recipe.material, recipe.fineness)


KIND = Kind("plane", {"shape": table, **fineness_keys(0.5, 0.5)}, _plan)
