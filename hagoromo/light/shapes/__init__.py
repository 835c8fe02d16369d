"""Shapes of area lamps: a file each. The one that a table [[area_lamp]] means follows from its keys."""

from collections.abc import Mapping
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.record import decode
from hagoromo.light.shapes.lamp_shape import LampShape
from hagoromo.light.shapes.rectangle import Rectangle
from hagoromo.light.shapes.sphere import Sphere
from hagoromo.light.shapes.tube import Tube

SHAPES: tuple[type[LampShape], ...] = (Sphere, Rectangle, Tube)
KEYS = {key: shape for shape in reversed(SHAPES) for key in shape.__struct_fields__}  # the first that has each


def shape_of(keys: Mapping[str, Any], who: str) -> LampShape:
    """The shape that has just these keys. `InputError` for others, and for values that make none."""
    for shape in SHAPES:
        if set(shape.__struct_fields__) == keys.keys():
            return decode(dict(keys), shape, who).checked(who)
    known = ", or ".join(f"{' and '.join(shape.__struct_fields__)} (a {shape.__name__.lower()})" for shape in SHAPES)
    raise InputError(f"{who}: give either {known}")
