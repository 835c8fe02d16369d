"""Registry: the kinds of matter that recipes may name. Each is an entry point of the group `hagoromo.matter`.

A package adds a kind by the name of the kind, and where its `Kind` is; those of `hagoromo_matter` are added so, too.

    [project.entry-points."hagoromo.matter"]
    lichen = "my_package.lichen:KIND"
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import EntryPoint, entry_points

from hagoromo.errors import InputError
from hagoromo.matter.recipe import Kind

GROUP = "hagoromo.matter"


@cache
def _points() -> dict[str, EntryPoint]:
    """The kinds by name; the metadata of all packages is read for it once."""
    return {point.name: point for point in reversed(tuple(entry_points(group=GROUP)))}  # of one name the first is taken


def kind_names() -> tuple[str, ...]:
    """The names of all kinds, in the order of the alphabet; no package that has them is imported."""
    return tuple(sorted(_points()))


def kind_of(name: str) -> Kind:
    """The kind of matter called `name`, one of `kind_names()`.

    `InputError` when the package that names it cannot be imported, or holds no `Kind` there.
    """
    point = _points()[name]
    try:
        kind = point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"the kind of matter {name!r} ({point.value}) cannot be loaded: {error}") from error
    if not isinstance(kind, Kind):
        raise InputError(f"the kind of matter {name!r} ({point.value}) is a {type(kind).__name__}: it must be a Kind")
    return kind
