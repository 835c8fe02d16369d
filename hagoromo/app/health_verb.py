"""The command `hagoromo health`."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote
from hagoromo.files.whole import replaceable_file


@verb(verbs)
def health(capture: Positional[Path], out: Out, force: Force = False) -> None:
    """Capture → health.json: is each of its photographs in order, sharp, unmoved, and under the lamp that is stated?

    Eight checks, in seconds, each good, doubtful (why, what to do) or not testable (why). `measure` makes them, too.

    Args:
        capture: folder with transforms.json, its lamps known.
    """
    from hagoromo.files.record import save_json, written_by

    replaceable_file(out, force)
    found = hg.check_photographs(capture)
    save_json(out, {"hagoromo": written_by(), **found.record()}, force)
    say(*(check.sentence for check in found.checks))
    wrote(out)
