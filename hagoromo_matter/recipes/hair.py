"""Kind "hair": fibres along the curves of a file, [curves], or grown on a shape, [shape] and the keys of `Growth`.

[curves] is {file = "name.hair", unit_mm or height_mm, rotation_deg, diameter_mm}; see `read_curves`. Element cylinder.
Where fibres fill the space, a mean free path of their diameter (of half of it where extinction is "projected") is that
of opaque fibres.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.record import Positive, Record, Vector, about, decode, extended, like, one_of
from hagoromo.matter.fill import MM, Fineness
from hagoromo.matter.recipe import Kind, Recipe, RecipeTable, Voxel
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.hair.fibres import Curves, fibre_blocks, one_fibre
from hagoromo_matter.hair.growth import Growth, grown
from hagoromo_matter.hair.placed_curves import placed
from hagoromo_matter.recipes.form import FORMS, shape_of


class CurvesTable(Record, frozen=True):
    """Curves of a file, turned about x, then y, then z, and made as large as they are to be."""

    file: Annotated[str, about("file of curves: .hair, .obj, .glb and .gltf (lines), .abc, .usd, .usda, .usdc")]
    unit_mm: Annotated[Positive | None, about("length of a unit of the file [mm]; default: 1")] = None
    height_mm: Annotated[Positive | None, about("height of all curves together [mm], in the place of unit_mm")] = None
    rotation_deg: Annotated[Vector, about("turns about x, y and z [°]")] = (0.0, 0.0, 0.0)
    diameter_mm: Annotated[
        Positive | None, about("diameter of the fibres [mm]; default: that of the file, or 0.08")
    ] = None


class HairPlace(RecipeTable, frozen=True, kw_only=True):
    """Hair along curves of a file, or hair that grows on a shape."""

    curves: Annotated[dict[str, Any] | None, like(CurvesTable), about("curves of a file")] = None
    shape: Annotated[dict[str, Any] | None, like(*FORMS), about("shape that hair grows on")] = None
    origin: Annotated[
        str,
        one_of("floor", "own"),
        about("floor: hair ends at z = 0; own: it stays where the file or shape has it"),
    ] = "floor"
    voxel_mm: Voxel = 0.6
    mean_free_path_mm: Annotated[
        Positive | None,
        about("mean free path of light where fibres fill the space [mm]; default: that of opaque fibres"),
    ] = None


HairTable = extended("HairTable", HairPlace, Growth)
DIAMETER_MM = 0.08  # of fibres whose file states none
RESOLVED_DENSER = 4.0  # how much shorter the mean free path is in fibres that voxels resolve


def _plan(recipe: Recipe[Any]) -> BoxPlan:
    table = recipe.table
    if (table.curves is None) == (table.shape is None):
        raise InputError(f"{recipe.where}: give either [curves], a file, or [shape], on which hair grows")
    material = recipe.material  # checked before hair grows
    curves, voxel = _curves(recipe), table.voxel_mm / table.resolution
    path = table.mean_free_path_mm or opaque_path(curves.mean_diameter, voxel, table.extinction == "projected")
    blocks, pose = fibre_blocks(curves, voxel)
    tau = one_fibre(curves.mean_diameter, voxel) / (path * MM)
    return BoxPlan(BoxHeader(voxel * MM, tau, (material,), pose, name="hair"), blocks)


def opaque_path(diameter: float, voxel: float, is_projected: bool) -> float:
    """Mean free path [mm] at density 1 of opaque fibres: σ = (2/πr) f sinθ of a share f of space (Poisson's).

    Projected extinction has the factor (2/π) sinθ of its own. Fibres that voxels resolve are opaque by themselves.
    """
    shown = Fineness(voxel, diameter).resolved(diameter)
    return diameter * (0.5 if is_projected else 1.0) / (1.0 + (RESOLVED_DENSER - 1.0) * shown)


def _curves(recipe: Recipe[Any]) -> Curves:
    """The curves of the file, or those that grow, where they are to stand."""
    curves = _grown(recipe) if recipe.table.curves is None else _placed(recipe)
    if recipe.table.origin == "own":
        return curves
    low, high = curves.points.min(axis=0), curves.points.max(axis=0)
    middle = 0.5 * (low + high) if recipe.table.curves else np.zeros(3)  # a shape stands around x = y = 0
    return curves._replace(points=curves.points - [middle[0], middle[1], low[2]])


def _grown(recipe: Recipe[Any]) -> Curves:
    table = recipe.table
    growth = Growth(*(getattr(table, name) for name in Growth._fields))
    return grown(*shape_of(table.shape, f"{recipe.where} [shape]", recipe.file), growth, table.seed)


def _placed(recipe: Recipe[Any]) -> Curves:
    table = recipe.table
    record = decode(table.curves, CurvesTable, f"{recipe.where} [curves]")
    if record.unit_mm is not None and record.height_mm is not None:
        raise InputError(f"{recipe.where} [curves]: give unit_mm or height_mm, not both")
    return placed(recipe.file(record.file), record, record.diameter_mm, DIAMETER_MM)


KIND = Kind("cylinder", HairTable, _plan)
