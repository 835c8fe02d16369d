"""The command `hagoromo render`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.shared_options import AS_ON_SRGB, HERE, LookOfPicture, Scheduler
from hagoromo.app.verb import Force, Out, say, with_picture, wrote
from hagoromo.errors import InputError
from hagoromo.files.whole import replaceable_files
from hagoromo.image.scene.modes import Mode
from hagoromo.progress import LOADING, Progress, part_of

if TYPE_CHECKING:
    from hagoromo.image.film.film import Turn
    from hagoromo.image.picture.shown import DisplayView


def render(
    scene: Positional[Path],
    out: Out,
    mode: Mode = "march",
    tolerance: float | None = None,
    samples: int | None = None,
    seed: int | None = None,
    error: float | None = None,
    time: float | None = None,
    walks: int | None = None,
    separate_lamps: bool = False,
    resume: bool = False,
    layers: bool = False,
    denoise: bool = False,
    turntable: int | None = None,
    camera_orbit: int | None = None,
    lamp_orbit: int | None = None,
    fps: float | None = None,
    times: int | None = None,
    look: LookOfPicture = AS_ON_SRGB,
    scheduler: Scheduler = HERE,
    force: Force = False,
) -> None:
    """Scene → EXR (linear, with its weights) and PNG (sRGB); a scene that moves, or a turn → MP4, WebM, GIF or frames.

    Args:
        scene: scene TOML.
        mode: march computes single scattering, without noise; full solves light of all orders on
            a coarse grid, says what it is off and mends it; path estimates it, with noise.
        tolerance: error of the picture where there is matter, root mean square over mean (default: the scene's, or
            0.04).
        samples: rays a pixel, or random walks in mode path (default: the scene's, or 1).
        seed: seed of the random numbers (default: the scene's, or 0).
        error: in modes path and full, error at which to stop, root mean square over mean where there is matter, such
            as 0.01: in path the noise of pixels, in full what blocks of 8 × 8 pixels are off.
        time: in modes path and full, for how long to walk, about [s]. In full an error that takes more than ten
            minutes is refused without it.
        walks: in mode full, how many random walks state and mend its error, about, in the whole picture; 0 for none
            (default: as many as bring it to 0.01, up to 2^20). In mode march, 0 leaves out the few walks that say
            whether the scene has much light of higher orders.
        separate_lamps: every lamp gets weights of its own, so that `expose` can change its strength and colour.
        resume: go on with the unfinished picture that an interrupted run in mode path left at `--out`.
        layers: further channels: parts of the light (first.R, higher.R, body.R, interface.R, …), depth.Z, normal.X, …,
            albedo.R, … and material.id.
        denoise: R, G, B and the PNG without noise, as Open Image Denoise guesses; marked in the file; with layers.
        turntable: a film of so many frames in which the matter turns once before camera and lamps.
        camera_orbit: a film of so many frames in which the camera goes once round the matter.
        lamp_orbit: a film of so many frames in which the lamps go once round the matter.
        fps: frames a second of a film (default: the scene's, or 24).
        times: mean of pictures at so many times while the shutter ([motion] shutter_close) is open, in any mode
            (default: mode path follows what moves, walk by walk).
    """
    turn = turn_of(turntable, camera_orbit, lamp_orbit)
    choices = {"tolerance": tolerance, "samples": samples, "seed": seed}
    choices |= {"error": error, "seconds": time, "walks": walks}
    stated: dict[str, Any] = {key: value for key, value in choices.items() if value is not None}
    if is_film(out, turn):
        if resume or layers or denoise or separate_lamps or times is not None:
            raise InputError(
                "a film goes on by itself, and has no layers: leave --resume, --layers, --denoise, --separate-lamps "
                "and --times out"
            )
        return write_film_of(scene, out, stated, turn, fps, scheduler.chosen, force, mode, look.chosen)
    from hagoromo.image.picture.shown import DisplayTransform

    if denoise:
        from hagoromo.image.picture.denoise import name_of_denoiser

        name_of_denoiser()
    DisplayTransform(display := look.chosen)  # refuses what there is not before the work
    unfinished = _unfinished(out) if resume else None
    replaceable_files(with_picture(out).files, force or resume)
    from hagoromo.image.render import motion_with_shutter
    from hagoromo.image.scene.scene_file import camera_and_settings

    camera, settings = camera_and_settings(scene)
    settings = replace(settings, **stated)
    if separate_lamps:
        settings = replace(settings, separate_lamps=True)
    try:
        with progress_bar("render") as progress:
            given, rest = scene, progress
            if scheduler.chosen is None and mode == "march" and motion_with_shutter(scene) is None and times is None:
                given, rest = _loaded(scene, settings, progress)
            image = hg.render(given, settings, rest, scheduler.chosen, mode, unfinished, layers or denoise, times)
    except hg.RenderInterrupted as interrupt:
        interrupt.image.save(out, camera.response, force or resume, display=display)
        raise KeyboardInterrupt(f"{interrupt}, {out} is the picture so far: --resume goes on with it") from interrupt
    wrote(*image.save(out, camera.response, force or resume, denoise, display))
    if image.full_error is not None:
        say(image.full_error.line())
    if isinstance(given, hg.Scene):
        from hagoromo.image.suggested_mode import higher_share

        found = higher_share(given, image, settings)
        if found is not None and found.is_much:
            say(found.line())


def _loaded(scene: Path, settings: hg.Settings, progress: Progress) -> tuple[hg.Scene, Progress]:
    """A scene file that is rendered by mode march, loaded, and the progress of what is left."""
    from hagoromo.image.scene.scene_file import load_for_picture
    from hagoromo.image.scene.settings import check_mode

    check_mode(settings, "march")
    loaded, _ = load_for_picture(scene, settings, part_of(progress, 0.0, LOADING))
    return loaded, part_of(progress, LOADING, 1.0 - LOADING)


def _unfinished(out: Path) -> hg.Image:
    """The picture that an interrupted run left."""
    if not out.exists():
        raise InputError(f"{out} does not exist, so that there is nothing to resume: render it without --resume")
    return hg.read_image(out)


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
    look: DisplayView,
) -> None:
    """Render and write a film; stated: settings that replace those of the scene."""
    from hagoromo.image.scene.scene_file import camera_and_settings

    settings = replace(camera_and_settings(scene)[1], **stated) if stated else None
    with progress_bar("render") as progress:
        film = hg.film(
            scene, out, settings, turn, mode=mode, rate=fps, scheduler=scheduler, force=force, progress=progress,
            look=look,
        )  # fmt: skip
    kept = film.count - film.rendered
    say(f"{film.count} frames" + (f", {kept} of them were there" if kept else ""))
    wrote(film.frames, *([film.film] if film.film else []))
