"""Form: the table [shape] of a recipe → a shape that stands on z = 0 around x = y = 0, and room around it. In mm.

{form = "sphere", radius_mm}, {form = "ellipsoid", radii_mm = [x, y, z]}, {form = "box", size_mm = [x, y, z],
rounding_mm}, {form = "capsule", radius_mm, length_mm}, and for solids, skin and hair {form = "mesh", file = "name.ply",
height_mm, rotation_deg = [x, y, z]}, which is turned about x, then y, then z before it is measured.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any

from hagoromo.errors import InputError
from hagoromo.files.record import NotNegative, Positive, Record, Vector, about, decode_one
from hagoromo.matter.shape import Shape, capsule, ellipsoid, rounded_box, sphere
from hagoromo_matter.solid.solid import Extent, MeshSurface
from hagoromo_matter.solid.thin_parts import warn_of_thin

Sizes = tuple[Positive, Positive, Positive]
SHORTEST_MM = 1e-6  # least half side of a shape: kernels compute in single precision


class SphereForm(Record, frozen=True, tag_field="form", tag="sphere"):
    """A sphere."""

    radius_mm: Annotated[Positive, about("radius [mm]")]


class Ellipsoid(Record, frozen=True, tag_field="form", tag="ellipsoid"):
    """An ellipsoid along the axes."""

    radii_mm: Annotated[Sizes, about("half axes [x, y, z] [mm]")]


class Box(Record, frozen=True, tag_field="form", tag="box"):
    """A box along the axes."""

    size_mm: Annotated[Sizes, about("edges [x, y, z] [mm]")]
    rounding_mm: Annotated[NotNegative, about("radius of its edges [mm]")] = 0.0


class Capsule(Record, frozen=True, tag_field="form", tag="capsule"):
    """An upright cylinder with round ends."""

    radius_mm: Annotated[Positive, about("radius [mm]")]
    length_mm: Annotated[Positive, about("length of the cylinder, without its ends [mm]")]


class MeshForm(Record, frozen=True, tag_field="form", tag="mesh"):
    """A mesh, turned about x, then y, then z before it is measured."""

    file: Annotated[str, about("mesh file")]
    height_mm: Annotated[Positive, about("height [mm]")]
    rotation_deg: Annotated[Vector, about("turns about x, y and z [°]")] = (0.0, 0.0, 0.0)


FORMS = (SphereForm, Ellipsoid, Box, Capsule, MeshForm)


def form_of(record: dict[str, Any], where: str) -> SphereForm | Ellipsoid | Box | Capsule | MeshForm:
    """The checked keys of a [shape]."""
    return decode_one(record, FORMS, where)


def shape_of(
    record: dict[str, Any], where: str, file: Callable[[str], Path], voxel_mm: float | None = None
) -> tuple[Shape, Extent]:
    """The shape, and the corners of a box with room around it. file: the place of a file that the recipe names.

    voxel_mm: a warning says what of a mesh is thinner than two of these.
    """
    form = form_of(record, where)
    if isinstance(form, MeshForm):
        mesh = MeshSurface(file(form.file), form.height_mm, form.rotation_deg)
        if voxel_mm is not None:
            warn_of_thin(mesh.name, voxel_mm, mesh.thin_parts(2.0 * voxel_mm), "warn")
        room = 2.0 + 0.01 * float((mesh.high - mesh.low).max())
        return mesh.signed_distance, (tuple(mesh.low - room), tuple(mesh.high + room))
    if isinstance(form, SphereForm):
        half = (form.radius_mm,) * 3
        made: Shape = lambda p: sphere(p, (0.0, 0.0, half[2]), half[0])  # noqa: E731
    elif isinstance(form, Ellipsoid):
        half = form.radii_mm
        made = lambda p: ellipsoid(p, (0.0, 0.0, half[2]), half)  # noqa: E731
    elif isinstance(form, Box):
        half, rounding = (0.5 * form.size_mm[0], 0.5 * form.size_mm[1], 0.5 * form.size_mm[2]), form.rounding_mm
        if rounding > min(half):
            raise InputError(f"{where}: rounding_mm is {rounding:g}: give at most half of the shortest edge")
        made = lambda p: rounded_box(p, (0.0, 0.0, half[2]), half, rounding)  # noqa: E731
    else:
        radius, top = form.radius_mm, form.radius_mm + form.length_mm
        half = (radius, radius, 0.5 * (top + radius))
        made = lambda p: capsule(p, (0.0, 0.0, radius), (0.0, 0.0, top), radius)  # noqa: E731
    if min(half) < SHORTEST_MM:
        raise InputError(f"{where}: half of its shortest side is {min(half):g} mm: give {SHORTEST_MM:g} mm or more")
    room = 2.0 + 0.02 * max(half)
    return made, ((-half[0] - room, -half[1] - room, -room), (half[0] + room, half[1] + room, 2.0 * half[2] + room))
