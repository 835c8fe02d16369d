"""Options of `hagoromo capture --views`: photographs taken all around an object."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, Literal

from tyro.conf import arg

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import say, wrote
from hagoromo.errors import InputError

CAMERA = "camera"


@dataclass(frozen=True)
class ViewsOptions:
    """Photographs of many views."""

    views: bool = False
    """photographs all around an object by one camera: COLMAP finds poses and lens (pip install 'hagoromo[views]')."""

    lamp: Literal["flash", "unknown"] | None = None
    """with --views: flash: on the camera; unknown: fixed light that nobody measured."""

    flash_offset: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """with --lamp flash: where the flash is, to the right, down and forward from the camera [m]."""

    lamps_fixed_to: Annotated[
        str,
        arg(
            help="with --views and --lamps: camera: the lamps move with it, or the object turns before them; or the "
            "name of the photograph in whose camera's axes they are, if they are fixed in space. Without lamps of its "
            "name, each photograph has all."
        ),
    ] = CAMERA

    turntable: bool = False
    """with --views: the object turned before a camera that stood still: only points on its mask are used."""

    coefficients: Literal[0, 1, 2] = 1
    """with --views: coefficients of radial distortion that are fitted (k1, k2), where no --camera states the lens."""

    thorough: bool = False
    """with --views: also faint points, and points seen from aside: five times the work, for smooth matter (plaster)."""

    length: float | None = None
    """with --views: distance of two points [m], which gives the scale."""

    length_between: tuple[str, ...] = ()
    """with --length: where these two points are: PHOTOGRAPH,x1,y1,x2,y2 [px], in two photographs or more."""

    board: str | None = None
    """with --views: a calibration board stands beside the object: inner corners, columns x rows, such as 9x6."""

    square: float | None = None
    """with --board: side of its squares [m]."""

    largest: int = 1600
    """with --views: longer side of the pictures in which points are sought [px]."""

    seed: int = 0
    """with --views: of all that chance decides."""


ManyViews = Annotated[ViewsOptions, arg(name="")]
ONE_VIEW = ViewsOptions()


def check_one_view(options: ViewsOptions) -> None:
    """`InputError` for options of many views without --views."""
    named = [one.name for one in fields(options) if getattr(options, one.name) != getattr(ONE_VIEW, one.name)]
    if named:
        raise InputError(f"--{named[0].replace('_', '-')} is for photographs of many views: add --views, or omit it")


def light_of(
    options: ViewsOptions, lamps: Path | None, spectrum: str | None, intensity: Sequence[float]
) -> hg.ViewLight:
    """Where the light comes from; `InputError` where nothing says it."""
    import numpy as np

    from hagoromo.photograph.lamp_files import faces_up, load_lamps
    from hagoromo.photograph.session import as_stated

    if (lamps is None) == (options.lamp is None):
        raise InputError(
            "say where the light came from, once: --lamp flash (on the camera), --lamps FILE, or --lamp unknown"
        )
    if any(options.flash_offset) and options.lamp != "flash":
        raise InputError("--flash-offset is of a flash on the camera: add --lamp flash, or omit it")
    if options.lamp == "unknown":
        return hg.ViewLight()
    if lamps is None:
        stated = as_stated(hg.Lamp(to_lamp=(0.0, 0.0, 1.0)), spectrum, intensity or None)
        return hg.ViewLight(options.flash_offset, intensity=stated.intensity, spectrum=stated.spectrum)
    listed = [as_stated(lamp, spectrum, intensity or None) for lamp in load_lamps(lamps)]
    if faces_up(lamps):  # x right, y up, z to the camera
        listed = [_turned(lamp, np.array([1.0, -1.0, -1.0])) for lamp in listed]
    return hg.ViewLight(lamps=listed, fixed_to=options.lamps_fixed_to)


def _turned(lamp: hg.Lamp, signs: Any) -> hg.Lamp:
    """A far lamp whose direction has its axes reversed by `signs`."""
    return hg.Lamp(to_lamp=lamp.place * signs, intensity=lamp.intensity, spectrum=lamp.spectrum, name=lamp.name)


def scale_of(
    options: ViewsOptions, balls: Sequence[Path], radius: float | None
) -> hg.KnownLength | hg.KnownBall | hg.Board | None:
    """What of known size the photographs show; `InputError` for more than one, or a part of it."""
    from hagoromo.app.calibrations import board_of
    from hagoromo.calibration.views.known_length import read_marks

    pairs = {
        "--length and --length-between": (options.length, options.length_between or None),
        "--board and --square": (options.board, options.square),
        "--ball and --radius": (tuple(balls) or None, radius),
    }
    for names, (one, other) in pairs.items():
        if (one is None) != (other is None):
            raise InputError(f"{names} go together for the scale of views: give both or none")
    stated = [names for names, (one, _) in pairs.items() if one is not None]
    if len(stated) > 1:
        raise InputError(f"{stated[0]}, and {stated[1]}, give the scale twice: give one")
    if options.length is not None:
        return hg.KnownLength(options.length, read_marks(options.length_between, 4, "--length-between"))
    if options.board is not None and options.square is not None:
        return board_of(options.board, options.square)
    if radius is not None:
        return hg.KnownBall(radius, read_marks([str(ball) for ball in balls], 3, "--ball"))
    return None


def write_views(
    photographs: Sequence[Path], out: Path, options: ViewsOptions, stated: dict[str, Any], force: bool
) -> None:
    """Write the capture of many views and say what was found. stated: further arguments of `hg.capture_views`."""
    settings = hg.ViewsSettings(
        options.turntable, options.coefficients, options.thorough, options.largest, options.seed
    )
    with progress_bar("capture") as progress:
        written = hg.capture_views(photographs, out, settings=settings, force=force, progress=progress, **stated)
    for remark in written.remarks:
        warnings.warn(remark, stacklevel=2)
    say(*written.lines())
    wrote(out, written.work)
