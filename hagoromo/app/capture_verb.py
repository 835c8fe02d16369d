"""The command `hagoromo capture`."""

from __future__ import annotations

import warnings
from pathlib import Path

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote
from hagoromo.files.whole import replaceable_folder


@verb(verbs)
def capture(
    photographs: Positional[tuple[Path, ...]],
    lamps: Path,
    out: Out,
    camera: Path | None = None,
    response: str | None = None,
    mask: tuple[Path, ...] = (),
    spectrum: str | None = None,
    intensity: tuple[float, ...] = (),
    undistorted: bool = False,
    transfer: str | None = None,
    exposures: tuple[float, ...] = (),
    iso: float | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
    gain: float | None = None,
    read_noise: float | None = None,
    force: Force = False,
) -> None:
    """Photographs of one view, one lamp on in each → a capture for `measure`; any number, in the memory of one.

    Args:
        photographs: RAW, TIFF, JPEG or PNG as the camera left them, or EXR of `develop`, all from one viewpoint.
        lamps: lamps.json of `calibrate lamps`, or an .lp. A photograph gets the lamp with its name; if no name
            matches, lamps are assigned in order.
        camera: camera.json of `calibrate camera`, or OpenCV's YAML, as given to `calibrate lamps`; or orthographic.
            Without it the focal length in the EXIF is used, or else the view is assumed orthographic.
        response: CSV of `calibrate response`, or the name of a known camera.
        mask: PNG that is white on the object: one for all photographs, or one each. auto: the object is found in the
            photographs; a PNG after it corrects that, white object, black background, grey as found.
        spectrum: spectrum of the lamps: a name such as A or D65, or a CSV.
        intensity: intensity of the lamps, instead of that in lamps.json: one number, or one per channel. Under a far
            lamp of intensity 3.1416 a white patch that faces it has the value 1.
        undistorted: the photographs have no lens distortion (those of `develop --undistort` state it themselves).
        transfer: transfer curve of 8-bit photographs: linear, srgb, or a CSV with the columns number and light (or R,
            G, B).
        exposures: exposure times [s], one for all or one each, if the files do not state them.
        iso: ISO speed of all, if the files do not state it.
        black: black level [DN], if the files do not state it.
        white: saturation level [DN].
        mosaic: mosaic of one-channel files, such as RGGB.
        gain: gain of the sensor [electrons per DN], with read_noise; by default both are estimated.
        read_noise: read noise of the sensor [electrons].
    """
    replaceable_folder(out, force)
    asked = hg.session(
        photographs, lamps, camera, response, mask, spectrum=spectrum, intensity=intensity or None,
        undistorted=undistorted,
        developing=hg.Developing(black, white, mosaic, transfer, gain, read_noise, exposures, iso),
    )  # fmt: skip
    with progress_bar("capture") as progress:
        written = hg.capture_to(asked, out, force, progress)
    for remark in written.remarks:
        warnings.warn(remark, stacklevel=2)
    for name, lamp in written.lamps.items():
        say(f"{name}: lamp {lamp}")
    for what, assumed in written.assumptions.items():
        say(f"{what}: {assumed}")
    wrote(out)
