"""Build: a recipe (MATTER.toml, or the same as a dictionary) → VolumeBox that stands on z = 0 and faces −y.

In memory, or straight to disk, where it may be larger than the memory.

    kind = "skin"        granule_mm, field_mm, furrow_mm, fade_mm: see `Granules`; size_mm of a patch, or [shape]
    kind = "cloth"       threads_per_cm, diameter_mm, warp, crimp, uneven: see `Weave`; width_mm, height_mm, folds,
                         fold_depth_mm (0: flat) of a patch, or [shape] that it covers
    kind = "feather"     length_mm, outer_mm, inner_mm, barb_mm, rachis_mm, quill, bow_mm: see `Plume`
    kind = "solid"       [shape]
    kind = "volume"      density = "NAME.zarr" and, where there is one, axis: Zarr arrays, see `box_from_zarr`; scale
    kind = "figure"      part = "skin", "cloth" or "feather" of the winged, draped figure, 0.3 m high

All kinds: [material]; name; seed (whole number); resolution (1: as stated; 2: voxels half as large); and, but for the
figure, voxel_mm and mean_free_path_mm (of light where the density is 1: matter several times as thick is opaque).

[material] is {alpha, beta, gamma [rad], n, body_colour, interface_colour, element, name} or a measured one:
{file = "materials.json", material = "name", element, response, lamp}. Without `element` it is the kind's: sphere for
skin, cylinder for cloth and feather, plane for solid.
[shape] is {form = "sphere", radius_mm}, {form = "ellipsoid", radii_mm = [x, y, z]}, {form = "box", size_mm = [x, y, z],
rounding_mm}, {form = "capsule", radius_mm, length_mm} or, for a solid, {form = "mesh", file = "name.ply", height_mm}.
Paths lie in the folder of the recipe.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays
from hagoromo.errors import InputError, described
from hagoromo.files.record import (
    count,
    inside,
    number,
    numbers,
    one_of,
    positive,
    read_toml,
    table,
    take,
    text,
)
from hagoromo.files.whole import replaceable_folder
from hagoromo.matter.cloth import Weave, check_weave, covering
from hagoromo.matter.drape import drape_patch
from hagoromo.matter.feather import Plume, feather
from hagoromo.matter.figure import PARTS, figure_part
from hagoromo.matter.fill import MM, Fineness, fill
from hagoromo.matter.fingerprint import fingerprint
from hagoromo.matter.shape import Shape, capsule, ellipsoid, rounded_box, sphere
from hagoromo.matter.skin import Granules, skin, skin_patch
from hagoromo.matter.solid import Extent, mesh_solid, solid
from hagoromo.reflectance.material_table import reflectance_from_table
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.build_store import build_box
from hagoromo.volume.header import BoxHeader
from hagoromo.volume.plan import BoxPlan
from hagoromo.volume.zarr_plan import ZarrVolume

KINDS = {
    "skin": "sphere", "cloth": "cylinder", "feather": "cylinder", "solid": "plane", "volume": "plane", "figure": "",
}  # fmt: skip
FIGURE_ELEMENTS = {"skin": "sphere", "cloth": "cylinder", "feather": "cylinder"}
# voxel and mean free path [mm]
FINENESS = {
    "skin": (0.12, 0.3), "cloth": (0.12, 0.2), "feather": (0.12, 0.12), "solid": (0.5, 0.5), "volume": (0.5, 0.5),
}  # fmt: skip
FORMS = ("sphere", "ellipsoid", "box", "capsule", "mesh")
Progress = Callable[[float], None]


def build(recipe: Mapping[str, Any] | str | Path, progress: Progress | None = None) -> VolumeBox:
    """The volume box of a recipe: the path of a TOML file, or its tables; see the head of this module for the keys.

    progress: told the share done, 0…1. `InputError` names the key that is wrong, or unknown together with the known.
    """
    plan, where, _ = _planned(recipe)
    if progress:
        progress(0.0)
    with described(where):
        box = plan.box()
    if progress:
        progress(1.0)
    return box


def build_to(
    recipe: Mapping[str, Any] | str | Path, path: str | Path, force: bool = False, progress: Progress | None = None
) -> None:
    """Build the box of a recipe at `path`, block by block: memory follows a block, and a run cut off is taken up again.

    See `build`, and `resumable_folder` for what is raised besides.
    """
    replaceable_folder(path, force)  # before any work
    plan, where, folder = _planned(recipe)
    with described(where):
        known = fingerprint(plan.header.provenance["recipe"], folder)
    build_box(plan, path, known, force, progress)


def _planned(recipe: Mapping[str, Any] | str | Path) -> tuple[BoxPlan, str, Path | None]:
    """The plan of a recipe's box; what messages call the recipe; the folder of the files that it names."""
    if isinstance(recipe, (str, Path)):
        record, where, folder = read_toml(recipe), str(recipe), Path(recipe).parent
    else:
        record, where, folder = dict(recipe), "recipe", None
    kind = take(record, {"kind": one_of(*KINDS)}, where, strict=False)["kind"]
    key = take(record, RECIPES[kind] | ALL | ({} if kind == "figure" else _fineness_keys(kind)), where)
    element = KINDS[kind] or FIGURE_ELEMENTS[key["part"]]
    material = reflectance_from_table(key["material"], folder, f"{where} [material]", element)
    with described(where):
        plan = MAKERS[kind](key, material, folder, where)
    return plan.named(key["name"], {"recipe": record}), where, folder


def _skin(key: dict[str, Any], material: Reflectance, folder: Path | None, where: str) -> BoxPlan:
    granules, fine = Granules(*(key[name] for name in Granules._fields)), _fineness(key)
    if key["shape"] is None:
        return skin_patch(material, key["size_mm"], granules, fine, key["seed"])
    shape, extent = _shape(key["shape"], f"{where} [shape]")
    bound = fine.layer(shape, granules.fade_mm + granules.granule_mm)
    return fill(lambda p: skin(p, shape, granules, fine, key["seed"]), bound, extent, fine, material, name="skin")


def _cloth(key: dict[str, Any], material: Reflectance, folder: Path | None, where: str) -> BoxPlan:
    weave, fine = check_weave(Weave(*(key[name] for name in Weave._fields))), _fineness(key)
    if key["shape"] is None:
        size, folds = (key["width_mm"], key["height_mm"]), (max(key["folds"], 1), key["fold_depth_mm"])
        return drape_patch(material, size, weave, folds, fine, key["seed"])
    shape, extent = _shape(key["shape"], f"{where} [shape]")
    around = 0.5 * (extent[1][0] - extent[0][0])

    def chart(point: Any) -> tuple[Any, Any, Any]:
        return dr.atan2(point.x, -point.y) * around, point.z, arrays().Array3f(0, 0, 1)

    def field(point: Any) -> tuple[Any, Any]:
        return covering(point, shape, chart, weave, fine, key["seed"])

    return fill(field, fine.layer(shape, 0.5 * weave.diameter_mm), extent, fine, material, name="cloth")


def _feather(key: dict[str, Any], material: Reflectance, folder: Path | None, where: str) -> BoxPlan:
    return feather(material, Plume(*(key[name] for name in Plume._fields)), _fineness(key), key["seed"])


def _solid(key: dict[str, Any], material: Reflectance, folder: Path | None, where: str) -> BoxPlan:
    if key["shape"].get("form") == "mesh":
        mesh = take(key["shape"], {"form": text, "file": text, "height_mm": positive}, f"{where} [shape]")
        path = Path(mesh["file"]) if folder is None else inside(folder, mesh["file"])
        return mesh_solid(path, mesh["height_mm"], material, _fineness(key))
    return solid(*_shape(key["shape"], f"{where} [shape]"), material, _fineness(key))


def _volume(key: dict[str, Any], material: Reflectance, folder: Path | None, where: str) -> BoxPlan:
    if key["resolution"] != 1.0:
        raise InputError(f"{where}: resolution is for other kinds: a volume has the voxels that it has")
    named = {name: key[name] for name in ("density", "axis") if key[name]}
    paths = {name: Path(path) if folder is None else inside(folder, path) for name, path in named.items()}
    blocks = ZarrVolume(**paths, scale=key["scale"])
    voxel, pose = key["voxel_mm"] * MM, np.eye(4)
    pose[:2, 3] = -0.5 * voxel * np.array(blocks.shape[:0:-1])
    return BoxPlan(BoxHeader(voxel, 1.0 / (key["mean_free_path_mm"] * MM), (material,), pose, name="volume"), blocks)


def _figure(key: dict[str, Any], material: Reflectance, folder: Path | None, where: str) -> BoxPlan:
    return figure_part(key["part"], material, key["resolution"], key["seed"])


def _shape(record: dict[str, Any], where: str) -> tuple[Shape, Extent]:
    """A shape that stands on z = 0 around x = y = 0, and the corners of a box with room around it."""
    form = take(record, {"form": one_of(*FORMS)}, where, strict=False)["form"]
    if form == "mesh":
        raise InputError(f"{where}: form 'mesh' is for kind 'solid': give one of {', '.join(FORMS[:-1])}")
    key = take(record, {"form": text} | SHAPES[form], where)
    if form == "sphere":
        half = (key["radius_mm"],) * 3
        found: Shape = lambda p: sphere(p, (0.0, 0.0, half[2]), half[0])  # noqa: E731
    elif form == "ellipsoid":
        half = key["radii_mm"]
        found = lambda p: ellipsoid(p, (0.0, 0.0, half[2]), half)  # noqa: E731
    elif form == "box":
        half = tuple(0.5 * edge for edge in key["size_mm"])
        if key["rounding_mm"] > min(half):
            raise InputError(f"{where}: rounding_mm is {key['rounding_mm']:g}: give at most half of the shortest edge")
        found = lambda p: rounded_box(p, (0.0, 0.0, half[2]), half, key["rounding_mm"])  # noqa: E731
    else:
        radius, top = key["radius_mm"], key["radius_mm"] + key["length_mm"]
        half = (radius, radius, 0.5 * (top + radius))
        found = lambda p: capsule(p, (0.0, 0.0, radius), (0.0, 0.0, top), radius)  # noqa: E731
    room = 2.0 + 0.02 * max(half)
    return found, ((-half[0] - room, -half[1] - room, -room), (half[0] + room, half[1] + room, 2.0 * half[2] + room))


def _fineness(key: dict[str, Any]) -> Fineness:
    return Fineness(key["voxel_mm"], key["mean_free_path_mm"]).finer(key["resolution"])


def _fineness_keys(kind: str) -> dict[str, Any]:
    voxel, path = FINENESS[kind]
    return {"voxel_mm": (positive, voxel), "mean_free_path_mm": (positive, path)}


def _not_negative(value: Any) -> float:
    if number(value) < 0:
        raise ValueError("a number, 0 or more")
    return float(value)


def _share(value: Any) -> float:
    if not 0 <= number(value) < 1:
        raise ValueError("a number from 0 to below 1")
    return float(value)


def _sizes(value: Any) -> tuple[float, ...]:
    sizes = numbers(3)(value)
    if min(sizes) <= 0:
        raise ValueError("a list of 3 numbers above 0")
    return sizes


def _with_defaults(record: Any, kinds: Mapping[str, Any], other: Any = positive) -> dict[str, Any]:
    """Keys of a record's fields with its defaults; `kinds` for those that are not of kind `other`."""
    return {name: (kinds.get(name, other), value) for name, value in zip(record._fields, record, strict=True)}


ALL = {
    "kind": text, "material": table, "name": (text, ""), "seed": (count, 0), "resolution": (positive, 1.0),
}  # fmt: skip
RECIPES: dict[str, dict[str, Any]] = {
    "skin": {
        "size_mm": (positive, 40.0), "shape": (table, None),
        **_with_defaults(Granules(), {"furrow_mm": _not_negative, "fade_mm": _not_negative}),
    },
    "cloth": {
        "width_mm": (positive, 60.0), "height_mm": (positive, 70.0), "folds": (count, 3),
        "fold_depth_mm": (_not_negative, 7.0), "shape": (table, None),
        **_with_defaults(Weave(), {"crimp": _not_negative, "uneven": _share}),
    },
    "feather": _with_defaults(Plume(), {"quill": _share, "bow_mm": number}),
    "solid": {"shape": table},
    "volume": {"density": text, "axis": (text, ""), "scale": (positive, 1.0)},
    "figure": {"part": one_of(*PARTS)},
}  # fmt: skip
SHAPES: dict[str, dict[str, Any]] = {
    "sphere": {"radius_mm": positive},
    "ellipsoid": {"radii_mm": _sizes},
    "box": {"size_mm": _sizes, "rounding_mm": (_not_negative, 0.0)},
    "capsule": {"radius_mm": positive, "length_mm": positive},
}
MAKERS = {"skin": _skin, "cloth": _cloth, "feather": _feather, "solid": _solid, "volume": _volume, "figure": _figure}
