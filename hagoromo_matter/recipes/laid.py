"""Laid: how a cloth lies, and the plan of its box: a texel of its micro-structure on the sheets that it makes. In mm.

lay = "flat"      a patch, width_mm × height_mm, that stands on z = 0 and faces −y
lay = "hanging"   the same, gathered into folds: their number, and fold_depth_mm at the hem
lay = "ball"      the same, fallen over a ball of radius_mm on the floor z = 0
lay = "draped"    the same, fallen over the body of [shape] on the floor z = 0
lay = "patch"     a flat patch without a texel, all of its voxels its own: for close-ups smaller than a repeat
lay = "mesh"      on the mesh of [shape], by its UV map, of which a unit is uv_mm = [u, v] of cloth

carrier_mm: voxels of the lattice of the chart; variants: of the texel, so that its repeat is not visible.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, TypeVar

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.files.record import NotNegative, Positive, about, decode, from_to, like, one_of
from hagoromo.matter.fill import MM, blocks_in
from hagoromo.matter.recipe import Recipe, RecipeTable
from hagoromo.matter.shape import coverage, rounded_box
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.cloth.fabric import Fabric
from hagoromo_matter.drape.drape import over_ball, over_body
from hagoromo_matter.drape.eased import eased
from hagoromo_matter.drape.hanging import flat, hanging
from hagoromo_matter.drape.mesh_chart import mesh_chart
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.drape.sheet_chart import sheet_chart
from hagoromo_matter.drape.uv_mesh import UvMesh, uv_mesh
from hagoromo_matter.recipes.form import FORMS, MeshForm, shape_of
from hagoromo_matter.texel.micro_structure import texel
from hagoromo_matter.texel.shell import shell

NARROW = 3.0  # [voxels of the carrier] width of cloth below which folds cannot be resolved
CARRIER_MARGIN = 2.0  # voxels of the carrier around the cloth
MOST_FOLDS, MOST_VARIANTS = 1000, 256
HEM = 3.0  # voxels of the carrier over which presence falls at a hem


class LaidTable(RecipeTable, frozen=True, kw_only=True):
    """How a cloth lies."""

    lay: Annotated[
        str,
        one_of("flat", "hanging", "ball", "draped", "patch", "mesh"),
        about(
            "flat, hanging in folds, fallen over a ball or over the body of shape, a flat patch without repeat, or on "
            "a mesh by its UV map"
        ),
    ] = "flat"
    width_mm: Annotated[Positive, about("width of the cloth [mm]")] = 30.0
    height_mm: Annotated[Positive, about("height of the cloth [mm]")] = 30.0
    folds: Annotated[int, from_to(0, MOST_FOLDS), about("number of folds of a hanging cloth")] = 3
    fold_depth_mm: Annotated[NotNegative, about("depth of the folds at the hem [mm]")] = 7.0
    radius_mm: Annotated[Positive, about("radius of the ball under the cloth [mm]")] = 12.0
    shape: Annotated[
        dict[str, Any] | None, like(*FORMS), about("body that the cloth is draped over, or mesh that it is laid on")
    ] = None
    uv_mm: Annotated[
        tuple[Positive, Positive] | None,
        about("cloth on a unit of the mesh's UV map, along u and v; default: as much as it stretches least [mm]"),
    ] = None
    carrier_mm: Annotated[Positive, about("voxels of the lattice that says where the cloth is [mm]")] = 0.8
    variants: Annotated[int, from_to(0, MOST_VARIANTS), about("variants of the repeat, so that it is not visible")] = 4


L = TypeVar("L", bound=LaidTable)


def laid(recipe: Recipe[L], fabric: Fabric, materials: Sequence[Reflectance], name: str) -> BoxPlan:
    """The plan of a box of `fabric` as the recipe lays it; one material per population."""
    if (recipe.table.lay in ("draped", "mesh")) != (recipe.table.shape is not None):
        raise InputError(f'{recipe.where}: lay = "draped" or "mesh" and [shape] go together: give both or none')
    if recipe.table.lay == "patch":
        return _patch(recipe, fabric, materials, name)
    voxel, carrier = recipe.fineness.voxel_mm, recipe.table.carrier_mm
    made = texel(
        fabric.field, fabric.period_mm, fabric.heights_mm, voxel, fabric.populations, max(recipe.table.variants, 1)
    )
    reach = max(abs(height) for height in fabric.heights_mm) + CARRIER_MARGIN * carrier
    if recipe.table.lay == "mesh":
        chart, bound, extent = mesh_chart(_uv_mesh(recipe, fabric), reach, HEM * carrier)
    else:
        chart, bound, extent = sheet_chart(_sheets(recipe, NARROW * carrier), reach, HEM * carrier, fabric.period_mm)
    path = recipe.fineness.mean_free_path_mm
    return shell(chart, bound, extent, carrier, made, path, materials, recipe.table.extinction, name=name)


def _patch(recipe: Recipe[L], fabric: Fabric, materials: Sequence[Reflectance], name: str) -> BoxPlan:
    """A flat patch from the middle of the repeat, laid out voxel by voxel."""
    jit, fine = arrays(), recipe.fineness
    (wide, tall), (low, high) = (recipe.table.width_mm, recipe.table.height_mm), fabric.heights_mm

    def field(point: Any) -> tuple[Any, Any, Any]:
        turns = (x * (1.0 / period) + 0.5 for x, period in zip((point.x, point.z), fabric.period_mm, strict=True))
        u, v = ((t - dr.floor(t)) * period for t, period in zip(turns, fabric.period_mm, strict=True))
        density, tangent, population = fabric.field(jit.Array3f(u, v, -point.y), jit.UInt(0))
        edge = rounded_box(point, (0.0, 0.0, 0.5 * tall), (0.5 * wide, high - low, 0.5 * tall))
        return (
            density * coverage(edge, fine.softness),
            jit.Array3f(tangent.x, -tangent.z, tangent.y),
            population,
        )

    room = fine.softness
    extent = (-0.5 * wide - room, -high - room, -room), (0.5 * wide + room, -low + room, tall + room)
    blocks, pose = blocks_in(field, lambda p: 0.0 * p.x - 1.0, extent, fine.voxel_mm)
    tau = 1.0 / (fine.mean_free_path_mm * MM)
    return BoxPlan(BoxHeader(fine.voxel_mm * MM, tau, tuple(materials), pose, name=name), blocks)


def _uv_mesh(recipe: Recipe[L], fabric: Fabric) -> UvMesh:
    """The mesh of [shape] with its UV map; one line about it is said."""
    form = decode(recipe.table.shape or {}, MeshForm, f"{recipe.where} [shape]")
    cloth = uv_mesh(recipe.file(form.file), form.height_mm, form.rotation_deg, recipe.table.uv_mm, fabric.period_mm)
    cloth.say(form.file)
    return cloth


def _sheets(recipe: Recipe[L], narrow: float) -> list[Sheet]:
    """The sheets that the cloth makes; folds of less than `narrow` [mm] of cloth are eased."""
    size = recipe.table.width_mm, recipe.table.height_mm
    if recipe.table.lay == "hanging":
        return [hanging(size, recipe.table.folds, recipe.table.fold_depth_mm, recipe.table.seed)]
    if recipe.table.lay == "ball":
        return [eased(over_ball(size, recipe.table.radius_mm, recipe.table.seed), narrow)]
    if recipe.table.lay == "draped":
        body, (low, high) = shape_of(recipe.table.shape or {}, f"{recipe.where} [shape]", recipe.file)
        return [eased(over_body(size, body, low, high, recipe.table.seed), narrow)]
    return [flat(size)]
