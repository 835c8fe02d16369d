"""Registry: the kinds of matter that recipes may name. Each is an entry point of the group `hagoromo.matter`.

A package adds a kind by the name of the kind, and where its `Kind` is; those of `hagoromo_matter` are added so, too.

    [project.entry-points."hagoromo.matter"]
    lichen = "my_package.lichen:KIND"
"""

from __future__ import annotations

from functools import cache
from importlib.metadata import entry_points

from hagoromo.errors import InputError
from hagoromo.matter.recipe import Kind

GROUP = "hagoromo.matter"


@cache
def kind_names() -> tuple[str, ...]:
    """The names of all kinds, in the order of the alphabet; no package that has them is imported."""
    return tuple(sorted(entry_points(group=GROUP).names))


def kind_of(name: str) -> Kind:
    """The kind of matter called `name`, one of `kind_names()`.

    `InputError` when the package that names it cannot be imported, or holds no `Kind` there.
    """
    (point, *_) = entry_points(group=GROUP, name=name)
    try:
        kind = point.load()
    except (ImportError, AttributeError) as error:
        raise InputError(f"the kind of matter {name!r} ({point.value}) cannot be loaded: {error}") from error
    if not isinstance(kind, Kind):
        raise InputError(f"the kind of matter {name!r} ({point.value}) is a {type(kind).__name__}: it must be a Kind")
    return kind
