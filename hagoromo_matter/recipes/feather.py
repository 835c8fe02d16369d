"""Kind "feather": a single feather that stands on its quill, or a patch of its vane.

    type = "primary" | "secondary" | "covert" | "contour" | "down": what is usual, where the tables leave it out
    [plume] form and shaft, [barbs], [barbules], [down], [marking] of a second colour: see `Feather` and its records
    after: length of its afterfeather as a share of its own
    patch_mm = [across, along], middle_mm = [across, along]: only a patch of the vane, laid flat
    [marking_material], [shaft_material]: keys of [material] that markings and shaft have in its place

Element cylinder.
"""

from __future__ import annotations

from typing import Annotated, Any

from hagoromo.files.record import Pair, Positive, about, decode, given, like, one_of, optional
from hagoromo.matter.recipe import Kind, Recipe, RecipeTable
from hagoromo.reflectance.material.material_table import PARTS
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.feather.feather import FEATHER_FINENESS, PATCH_FINENESS, feather, vane_patch
from hagoromo_matter.feather.kinds import FEATHERS
from hagoromo_matter.feather.vane import Feather

USUAL_FEATHER = Feather()
TABLES = {
    name: optional(f"{type(getattr(USUAL_FEATHER, name)).__name__}Table", type(getattr(USUAL_FEATHER, name)))
    for name in ("plume", "barbs", "barbules", "down", "marking")
}


class FeatherTable(RecipeTable, frozen=True, kw_only=True):
    """A single feather, or a patch of its vane; what its tables leave out is usual for its type."""

    type: Annotated[str, one_of(*FEATHERS), about("type of the feather")] = "primary"
    plume: Annotated[dict[str, Any], like(TABLES["plume"]), about("form and shaft")] = {}
    barbs: Annotated[dict[str, Any], like(TABLES["barbs"]), about("barbs of the vane")] = {}
    barbules: Annotated[dict[str, Any], like(TABLES["barbules"]), about("barbules of the vane")] = {}
    down: Annotated[dict[str, Any], like(TABLES["down"]), about("downy foot of the vane")] = {}
    marking: Annotated[dict[str, Any], like(TABLES["marking"]), about("second pigment")] = {}
    after: Annotated[float | None, about("length of the afterfeather, as a share of the feather's; 0: none")] = None
    patch_mm: Annotated[Pair | None, about("[across, along]: only a patch of the vane, laid flat [mm]")] = None
    middle_mm: Annotated[Pair, about("[across, along]: middle of the patch [mm]")] = (4.0, 55.0)
    marking_material: Annotated[dict[str, Any], PARTS, about("what markings have in the place of [material]")] = {}
    shaft_material: Annotated[dict[str, Any], PARTS, about("what the shaft has in the place of [material]")] = {}
    voxel_mm: Annotated[Positive | None, about("edge of a voxel, at resolution 1 [mm]")] = None
    mean_free_path_mm: Annotated[Positive | None, about("mean free path of light in matter of density 1 [mm]")] = None


def _plan(recipe: Recipe[FeatherTable]) -> BoxPlan:
    table = recipe.table
    usual = FEATHERS[table.type]
    parts = {name: _part(recipe, name, getattr(usual, name)) for name in TABLES}
    made = Feather(**parts, after=usual.after if table.after is None else table.after)
    fine = PATCH_FINENESS if table.patch_mm else FEATHER_FINENESS
    fine = fine._replace(**{k: v for k in fine._fields if (v := getattr(table, k))}).finer(table.resolution)
    materials = [recipe.material, *(recipe.varied(name) for name in ("marking_material", "shaft_material"))]
    if table.patch_mm:
        return vane_patch(materials, made, table.patch_mm, table.middle_mm, fine, table.seed)
    return feather(materials, made, fine, table.seed)


def _part(recipe: Recipe[FeatherTable], name: str, usual: Any) -> Any:
    return usual._replace(**given(decode(getattr(recipe.table, name), TABLES[name], f"{recipe.where} [{name}]")))


KIND = Kind("cylinder", FeatherTable, _plan)
