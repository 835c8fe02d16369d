"""The command that publishes: measured object, or volume box, → a page that can be sent round."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, UseAppendAction, arg

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote

LAMPS = 64  # over the hemisphere, of a box or scene: 18° apart


@verb(verbs)
def publish(
    measured: Positional[Path],
    out: Out,
    capture: Path | None = None,
    title: str = "",
    fact: UseAppendAction[tuple[str, ...]] = (),
    notes: Path | None = None,
    lamps: Annotated[int | None, arg(help=f"how many lamps a box or scene is rendered under; default: {LAMPS}")] = None,
    error: float | None = None,
    force: Force = False,
) -> None:
    """Measured object, or volume box → a page that relights it in any browser, without server or network.

    NAME.html is one file of 5 MB at most; any other name is a folder with index.html and tiles at full resolution.
    A volume box (BOX.zarr) or SCENE.toml is rendered under many lamps and becomes one file.

    Args:
        measured: folder that `measure` wrote, BOX.zarr, or SCENE.toml.
        capture: folder that was measured: photographs to compare with.
        title: of the page: what the object is called; without it the name that the capture, or the box, states.
        fact: NAME=TEXT that the page says of the object, such as "Inventory number=1889.12"; any number of them.
        notes: file of notes on places of the photographs, as the page saves them (W3C Web Annotation).
        error: of display values between the lamps of a box or scene, of 255: lamps are added until it is reached,
            512 at most; without it, as many as --lamps says.
    """
    boxes = measured.suffix.lower() in (".toml", ".zarr")
    if boxes and capture is not None:
        raise hg.InputError(f"{measured} was rendered, not photographed: leave --capture out")
    if not boxes and (lamps, error) != (None, None):
        option = "--error" if lamps is None else "--lamps"
        raise hg.InputError(f"a measured object is lit by its reflectance, from everywhere: leave {option} out")
    facts = _facts(fact)
    for option in (["--fact"] if facts else []) + (["--notes"] if notes is not None else []):
        if boxes:
            raise hg.InputError(f"{measured} is no measured object: leave {option} out")
    with progress_bar("publish") as progress:
        if boxes:
            count = LAMPS if lamps is None else lamps
            page = hg.publish_scene(
                measured, out, lamps=count, error=error, title=title, force=force, progress=progress
            )
            said = [str(page)]
        else:
            page = hg.publish(
                measured, out, capture=capture, title=title, facts=facts, notes=notes, force=force, progress=progress
            )
            said = [str(page), *(f"lost of {each}" for each in page.lost)]
    say(*said)
    wrote(out if out.suffix.lower() in (".html", ".htm") else out / "index.html")


def _facts(texts: tuple[str, ...]) -> dict[str, str]:
    found: dict[str, str] = {}
    for text in texts:
        name, equals, said = (part.strip() for part in text.partition("="))
        if not (name and equals and said):
            raise hg.InputError(f"{text!r:.80} is no fact: give NAME=TEXT, such as 'Inventory number=1889.12'")
        found[name] = said
    return found
