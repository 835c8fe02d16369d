"""Kind "solid": [shape], or a mesh, of density 1; element plane.

[face_materials.NAME]   keys of [material] that the faces of the mesh's material NAME have in its place: `usemtl` of
                        an OBJ, a material of a glTF, or the colour of faces of a PLY, such as "#ff0000"
"""

from __future__ import annotations

from typing import Annotated, Any

from hagoromo.errors import InputError
from hagoromo.files.record import about, like
from hagoromo.matter.recipe import Kind, MeanFreePath, Recipe, RecipeTable, Voxel
from hagoromo.reflectance.material.material_table import PARTS
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.recipes.form import FORMS, MeshForm, form_of, shape_of
from hagoromo_matter.solid.solid import MeshSurface, mesh_solid, solid
from hagoromo_matter.solid.thin_parts import Thin


class SolidTable(RecipeTable, frozen=True, kw_only=True):
    """A solid: a shape, or any mesh, filled."""

    shape: Annotated[dict[str, Any], like(*FORMS), about("its shape")]
    thin: Annotated[
        Thin,
        about("what is thinner than two voxels of a mesh: made that thick, or left to let light through; both warn"),
    ] = "thicken"
    face_materials: Annotated[
        dict[str, Annotated[dict[str, Any], PARTS]],
        about("what faces of a material of the mesh, by its name, have in the place of [material]"),
    ] = {}
    voxel_mm: Voxel = 0.5
    mean_free_path_mm: MeanFreePath = 0.5


def _plan(recipe: Recipe[SolidTable]) -> BoxPlan:
    where = f"{recipe.where} [shape]"
    form = form_of(recipe.table.shape, where)
    named = recipe.table.face_materials
    if isinstance(form, MeshForm):
        own = [
            recipe.reflectance(recipe.table.material | keys, f"[face_materials.{name}]") for name, keys in named.items()
        ]
        mesh = MeshSurface(recipe.file(form.file), form.height_mm, form.rotation_deg, tuple(named))
        return mesh_solid(mesh, recipe.material, recipe.fineness, recipe.table.thin, own)
    if named:
        raise InputError(f'{recipe.where}: face_materials are for a mesh: leave them out, or give form = "mesh"')
    return solid(*shape_of(recipe.table.shape, where, recipe.file), recipe.material, recipe.fineness)


KIND = Kind("plane", SolidTable, _plan)
