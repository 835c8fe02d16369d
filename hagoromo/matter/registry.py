"""Registry: the kinds of matter that recipes may name: those of this package, and those that other packages add.

A package adds a kind by an entry point of the group `hagoromo.matter`: the name of the kind, and where its `Kind` is.

    [project.entry-points."hagoromo.matter"]
    lichen = "my_package.lichen:KIND"
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points

from hagoromo.errors import InputError
from hagoromo.matter.recipes import cloth, feather, hair, knit, relief, skin, solid, volume, wing
from hagoromo.matter.recipes.recipe import Kind

GROUP = "hagoromo.matter"
OWN = {
    "skin": skin.KIND,
    "cloth": cloth.KIND,
    "knit": knit.KIND,
    "feather": feather.KIND,
    "wing": wing.KIND,
    "hair": hair.KIND,
    "solid": solid.KIND,
    "volume": volume.KIND,
    "relief": relief.KIND,
}


@cache
def kind_names() -> tuple[str, ...]:
    """The names of all kinds, this package's first; nothing of other packages is imported."""
    return (*OWN, *sorted({point.name for point in entry_points(group=GROUP)} - set(OWN)))


def kind_of(name: str) -> Kind:
    """The kind of matter called `name`.

    `InputError` when another package names it but cannot be imported, or holds no `Kind` there.
    """
    if name in OWN:
        return OWN[name]
    (point, *_) = entry_points(group=GROUP, name=name)
    try:
        kind = point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"the kind of matter {name!r} ({point.value}) cannot be loaded: {error}") from error
    if not isinstance(kind, Kind):
        raise InputError(f"the kind of matter {name!r} ({point.value}) is a {type(kind).__name__}: it must be a Kind")
    return kind
