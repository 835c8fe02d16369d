"""The command that shows the cache of boxes and pictures, and clears it."""

from __future__ import annotations

from hagoromo.app.verb import say, verb, verbs
from hagoromo.files.cache import BOUND_MB, PLACE, cache


@verb(verbs, name="cache")
def show_cache(clear: bool = False) -> None:
    """Place, size and bound of what is kept on this machine: boxes of recipes that scenes name, parts of the demo.

    Args:
        clear: remove all of it.
    """
    known = cache()
    if known.why_not:
        say(f"nothing is kept: {known.why_not}", f"set {PLACE} to a folder of your own")
        return
    if clear:
        count, size = known.clear()
        say(f"removed {_counted(count)}, {size / 1e6:.1f} MB")
    sizes = [size for _, size, _ in known.entries()]
    say(
        f"place: {known.folder} (another: {PLACE}; none: {PLACE}=off)",
        f"size: {sum(sizes) / 1e6:.1f} MB in {_counted(len(sizes))}",
        f"bound: {known.bound / 1e6:.0f} MB (another: {BOUND_MB}); what was not used for longest goes first",
    )


def _counted(count: int) -> str:
    return f"{count} {'entry' if count == 1 else 'entries'}"
