"""The command `hagoromo capture`."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.shared_options import AS_STATED, Sensor, SensorOptions
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote
from hagoromo.app.views_options import ONE_VIEW, ManyViews, check_one_view, light_of, scale_of, write_views
from hagoromo.errors import InputError
from hagoromo.files.whole import replaceable_folder

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

AUTO = "auto"


@verb(verbs)
def capture(
    photographs: Positional[tuple[Path, ...]],
    out: Out,
    lamps: Path | None = None,
    ball: tuple[Path, ...] = (),
    radius: float | None = None,
    camera: Path | None = None,
    response: str | None = None,
    mask: tuple[Path, ...] = (),
    spectrum: str | None = None,
    intensity: tuple[float, ...] = (),
    undistorted: bool = False,
    bracket: tuple[Path, ...] = (),
    bracket_exposures: tuple[float, ...] = (),
    dark: tuple[Path, ...] = (),
    dark_exposures: tuple[float, ...] = (),
    flat: tuple[Path, ...] = (),
    sensor: Sensor = AS_STATED,
    many: ManyViews = ONE_VIEW,
    force: Force = False,
) -> None:
    """Photographs of one view, one lamp on in each → a capture for `measure`; any number, in the memory of one.

    With --views: photographs taken all around an object → a capture for `recover`.

    Args:
        photographs: RAW, TIFF, JPEG or PNG as the camera left them, or EXR of `develop`, all from one viewpoint; or the
            folder that they are in, whose files of another format than most have are left out.
        lamps: lamps.json of `calibrate lamps`, or an .lp; by default that in the folder of the photographs, where one
            is given. A photograph gets the lamp with its name; if no name matches, lamps are assigned in order.
        ball: picture that is white on a chrome ball in the photographs, or its circle x,y,radius in pixels, one for
            each ball, in place of lamps: each photograph then shows where its own lamp is. auto: the balls are found;
            see balls.png of the capture. Balls are no part of the object. With --views, a ball of known size that
            gives the scale: PHOTOGRAPH,x,y,radius of its outline in two photographs or more.
        radius: radius of the balls [m]: two or more then place near lamps, with a calibrated camera.
        camera: camera.json of `calibrate camera`, or OpenCV's YAML, as given to `calibrate lamps`; or orthographic.
            Without it the focal length in the EXIF is used, or else the view is assumed orthographic.
        response: CSV of `calibrate response`, or the name of a known camera.
        mask: PNG that is white on the object: one for all photographs, or one each. auto: the object is found in the
            photographs; a PNG after it corrects that, white object, black background, grey as found. With --views
            also a folder: the mask of IMG_1.jpg is IMG_1.png there.
        spectrum: spectrum of the lamps: a name such as A or D65, or a CSV.
        intensity: intensity of the lamps, instead of that in lamps.json: one number, or one per channel. Under a far
            lamp of intensity 3.1416 a white patch that faces it has the value 1.
        undistorted: the photographs have no lens distortion (those of `develop --undistort` state it themselves).
        bracket: three or more exposures of one scene by the same camera, which measure the curve of
            --transfer estimate.
        bracket_exposures: exposure times of the bracket [s], if its files do not state them.
        dark: frames without light; those whose exposure time is nearest are subtracted.
        dark_exposures: exposure times of the dark frames [s], if their files do not state them.
        flat: frames of an evenly lit white field, by which photographs are divided.
    """
    from hagoromo.photograph.capture_folder import write_capture
    from hagoromo.photograph.photograph_folder import lamp_list_in, photographs_in
    from hagoromo.photograph.session import session

    replaceable_folder(out, force)
    if len(photographs) == 1 and photographs[0].is_dir():
        lamps = lamps if lamps or ball or many.views else lamp_list_in(photographs[0])
        photographs = tuple(photographs_in(photographs[0]))
    stated: dict[str, Any] = asdict(sensor)
    developing = hg.Developing(
        exposures_s=stated.pop("exposures"), darks=dark, dark_exposures_s=dark_exposures, flats=flat, bracket=bracket,
        bracket_exposures_s=bracket_exposures, **stated,
    )  # fmt: skip
    if many.views:
        _refuse_for_views(undistorted=undistorted, bracket=bracket)
        stated_views = {
            "light": light_of(many, lamps, spectrum, intensity), "masks": mask, "scale": scale_of(many, ball, radius),
            "camera": camera, "response": response, "developing": developing,
        }  # fmt: skip
        return write_views(photographs, out, many, stated_views, force)
    check_one_view(many)
    if (lamps is None) == (not ball):
        raise InputError("lamps come from a file (--lamps) or from a chrome ball in the photographs (--ball): give one")
    shown = _on_balls(photographs, ball, radius, camera, sensor) if ball else None
    known = lamps if shown is None else shown.found.lamps
    assert known is not None
    asked = session(
        photographs, known, camera, response, mask, spectrum=spectrum, intensity=intensity or None,
        undistorted=undistorted, excluded=None if shown is None else shown.covered,
        developing=developing,
    )  # fmt: skip
    if shown is not None:
        how = "found in the photographs" if AUTO in map(str, ball) else "of " + ", ".join(path.name for path in ball)
        asked.assumptions["lamps"] = f"{len(asked.lamps)} from {len(shown.found.balls)} chrome balls {how}"
        asked.pictures |= {"balls.png": shown.picture, "ball_mask.png": shown.covered.astype("uint8") * 255}
    with progress_bar("capture") as progress:
        written = write_capture(asked, out, force, progress)
    for remark in written.remarks:
        warnings.warn(remark, stacklevel=2)
    for name, lamp in written.lamps.items():
        say(f"{name}: lamp {lamp}")
    for what, assumed in written.assumptions.items():
        say(f"{what}: {assumed}")
    wrote(out)


def _refuse_for_views(**options: object) -> None:
    """`InputError` for options that photographs of many views do not have."""
    stated = [name for name, value in options.items() if value]
    if stated:
        raise InputError(f"--{stated[0]} is for photographs of one view: omit it with --views")


class _OnBalls(NamedTuple):
    """Lamps that chrome balls show, where the balls cover the picture, and a picture of both."""

    found: hg.LampCalibration
    covered: NDArray[np.bool_]
    picture: NDArray[np.uint8]


def _on_balls(
    photographs: Sequence[Path],
    balls: Sequence[Path],
    radius: float | None,
    camera: Path | None,
    sensor: SensorOptions,
) -> _OnBalls:
    """The lamps that chrome balls in the photographs show, and what is said about them."""
    import numpy as np

    from hagoromo.app.calibration_report import ball_picture, lamp_summary
    from hagoromo.calibration.lamps.lamp_photographs import lamp_photographs
    from hagoromo.camera.camera import unplaced_camera
    from hagoromo.photograph.session import ORTHOGRAPHIC
    from hagoromo.photograph.session_exif import session_exif

    if not photographs:
        raise InputError("no photograph is given: give one per lamp")
    seen = lamp_photographs(photographs, None, False)
    first = seen[next(iter(seen))]
    shape = first.shape[0], first.shape[1]
    lens: hg.Camera | Path | None = None if str(camera) == ORTHOGRAPHIC else camera
    if camera is None:
        focal = session_exif(photographs, sensor.exposures, sensor.iso).focal_of(shape[1])
        lens = None if focal is None else unplaced_camera(shape[1], shape[0], focal)
    with progress_bar("chrome ball") as progress:
        found = hg.calibrate_lamps(photographs, balls, radius=radius, camera=lens, progress=progress)
    say(*lamp_summary(found))
    covered = np.any([ball.covers(shape) for ball in found.balls], axis=0)
    return _OnBalls(found, covered, ball_picture(first, found))
