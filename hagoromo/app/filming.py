"""Films of `hagoromo render`: which options ask for one, and what is said of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import say, wrote
from hagoromo.errors import InputError
from hagoromo.image.modes import Mode

if TYPE_CHECKING:
    from hagoromo.image.film.film import Turn


def turn_of(turntable: int | None, camera_orbit: int | None, lamp_orbit: int | None) -> Turn | None:
    """The turn that the options ask for; `InputError` for two of them."""
    from hagoromo.image.film.film import Turn

    turns = {
        "--turntable": (turntable, True, True),
        "--camera-orbit": (camera_orbit, True, False),
        "--lamp-orbit": (lamp_orbit, False, True),
    }
    asked = {name: Turn(frames, *what) for name, (frames, *what) in turns.items() if frames is not None}
    if len(asked) > 1:
        raise InputError(f"{' and '.join(asked)} ask for two films: give one of them")
    return next(iter(asked.values()), None)


def is_film(out: Path, turn: Turn | None) -> bool:
    """Whether the result is a film."""
    from hagoromo.files.film_file import SUFFIXES

    return turn is not None or out.suffix.lower() in SUFFIXES or not out.suffix


def write_film_of(
    scene: Path,
    out: Path,
    stated: dict[str, Any],
    turn: Turn | None,
    fps: float | None,
    scheduler: Any,
    force: bool,
    mode: Mode,
) -> None:
    """Render and write a film; stated: settings that replace those of the scene."""
    from hagoromo.image.scene_file import camera_and_settings

    settings = replace(camera_and_settings(scene)[1], **stated) if stated else None
    with progress_bar("render") as progress:
        film = hg.film(
            scene, out, settings, turn, mode=mode, rate=fps, scheduler=scheduler, force=force, progress=progress
        )
    kept = film.count - film.rendered
    say(f"{film.count} frames" + (f", {kept} of them were there" if kept else ""))
    wrote(film.frames, *([film.film] if film.film else []))
