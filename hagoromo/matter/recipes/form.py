"""Form: the table [shape] of a recipe → a shape that stands on z = 0 around x = y = 0, and room around it. In mm.

{form = "sphere", radius_mm}, {form = "ellipsoid", radii_mm = [x, y, z]}, {form = "box", size_mm = [x, y, z],
rounding_mm}, {form = "capsule", radius_mm, length_mm}; for a solid also {form = "mesh", file = "name.ply", height_mm,
rotation_deg = [x, y, z]}, which is turned about x, then y, then z before it is measured.
"""

from __future__ import annotations

from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.record import numbers, one_of, positive, take, text
from hagoromo.matter.recipes.recipe import not_negative, sizes
from hagoromo.matter.shape import Shape, capsule, ellipsoid, rounded_box, sphere
from hagoromo.matter.solid.solid import Extent

FORMS: dict[str, dict[str, Any]] = {
    "sphere": {"radius_mm": positive},
    "ellipsoid": {"radii_mm": sizes},
    "box": {"size_mm": sizes, "rounding_mm": (not_negative, 0.0)},
    "capsule": {"radius_mm": positive, "length_mm": positive},
    "mesh": {"file": text, "height_mm": positive, "rotation_deg": (numbers(3), (0.0, 0.0, 0.0))},
}


def form_keys(record: dict[str, Any], where: str) -> dict[str, Any]:
    """The checked keys of a [shape], `form` among them."""
    form = take(record, {"form": one_of(*FORMS)}, where, strict=False)["form"]
    return take(record, {"form": text} | FORMS[form], where)


def shape_of(record: dict[str, Any], where: str) -> tuple[Shape, Extent]:
    """The shape, and the corners of a box with room around it."""
    key = form_keys(record, where)
    form = key["form"]
    if form == "mesh":
        known = ", ".join(name for name in FORMS if name != "mesh")
        raise InputError(f"{where}: form 'mesh' is for kind 'solid': give one of {known}")
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
