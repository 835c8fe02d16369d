"""The commands `hagoromo calibrate camera`, `lamps`, `rig` and `response`."""

from __future__ import annotations

import re
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

import tyro
from tyro.conf import Positional, UseAppendAction

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, response_files, say, verb, with_picture, wrote
from hagoromo.errors import InputError
from hagoromo.files.whole import replaceable_file, replaceable_files, whole_files

DOUBTFUL_NOISE = 0.03  # relative noise of a reading beyond which spectra or illumination are probably wrong

calibrations = tyro.extras.SubcommandApp()


@verb(calibrations, "camera", with_picture)
def calibrate_camera(
    photographs: Positional[tuple[Path, ...]],
    out: Out,
    board: str,
    square: float,
    marker: float = 0.0,
    dictionary: str = "4X4_50",
    coefficients: Literal[0, 2, 4, 5, 8] = 5,
    square_pixels: bool = False,
    window: int | None = None,
    force: Force = False,
) -> None:
    """Photographs of a board → intrinsics and distortion with standard deviations, and a plot of the residuals.

    Args:
        photographs: PNG, JPEG or TIFF, all of one size, three or more.
        board: inner corners, columns x rows, such as 9x6.
        square: side of a square [m].
        marker: side of a marker [m] of a ChArUco board; 0 for a chessboard.
        dictionary: OpenCV's name of the marker dictionary.
        coefficients: number of fitted distortion coefficients: none; k1 k2; also p1 p2; also k3; also k4 k5 k6.
        square_pixels: one focal length for both axes.
        window: half side [px] of the search window of a corner (default: the largest without other edges).
    """
    from hagoromo.app.calibration_report import residual_plot
    from hagoromo.calibration.camera.board import OWN_WINDOWS

    _, plot = with_picture(out).files
    if plot == out:
        raise InputError(f"{out} is the name of a picture: give a name that ends in .json")
    target = board_of(board, square, marker, dictionary, window)
    with whole_files((out, plot), force) as (record, picture), progress_bar("calibrate camera") as progress:
        calibration = hg.calibrate_camera(photographs, target, coefficients, square_pixels, progress)
        calibration.save(record)
        picture.write_bytes(residual_plot(calibration))
    print(
        f"rms {calibration.rms:.3f} px over {len(calibration.boards)} photographs, "
        f"{len(calibration.skipped)} without a board"
    )
    for axis, value in zip("xy", calibration.camera.focal, strict=True):
        print(f"focal length {axis} {value:.2f} ± {calibration.standard_deviation[f'fl_{axis}']:.2f} px")
    windows = calibration.settings["windows"]
    if windows != OWN_WINDOWS:
        rms = ", ".join(f"{name} {figure:.3f} px" for name, figure in calibration.settings["left_out_rms_px"].items())
        say(f"corners by {windows}: photographs left out of the fit have rms {rms}")
    for name in calibration.outliers:
        say(f"{name}: rms {calibration.boards[name]:.3f} px, far above the others: check it, or leave it out")
    wrote(out, plot)


@verb(calibrations, "lamps")
def calibrate_lamps(
    photographs: Positional[tuple[Path, ...]],
    out: Out,
    mask: UseAppendAction[tuple[Path, ...]] = (),
    moved: bool = False,
    radius: float | None = None,
    camera: Path | None = None,
    reference: Path | None = None,
    reflectance: tuple[float, ...] = (),
    reference_normal: tuple[float, float, float] | None = None,
    reference_radius: float | None = None,
    mirror: tuple[float, ...] = (),
    object: Path | None = None,
    transfer: Literal["linear", "srgb"] | None = None,
    force: Force = False,
) -> None:
    """Photographs of chrome balls, one lamp on in each → direction or position, and intensity, of every lamp.

    One ball determines the directions of far lamps. Several balls, or one in several places, determine the positions of
    near lamps, and which lamps are far. A matte reference, or highlights that are not clipped, determine intensity and
    colour. Without a ball, a matte object determines the directions of far lamps to a few degrees, and their relative
    intensities.

    Args:
        photographs: one per lamp, all from one place: PNG, JPEG, TIFF, RAW or developed EXR.
        mask: picture that is white on a chrome ball and black elsewhere, or its circle x,y,radius in pixels; give one
            per ball. auto: the balls are found.
        moved: one ball in several places: give a --mask for each place, and all photographs of the first place, then
            those of the second in the same order of lamps, and so on.
        radius: radius of the chrome balls [m]; needed with several masks and --camera.
        camera: camera.json of `calibrate camera`, or OpenCV's YAML; without it the view is assumed orthographic.
            Directions are in its axes (x right, y down, z forward); without it x right, y up, z to the camera.
        reference: mask of a matte ball in the photographs (of the first place), or of a matte card.
        reflectance: reflectance of the reference, below 1: one number, or one per channel; the lamps' intensity is
            then absolute, in pi times the unit of the photographs' values (per channel), times m2 for near lamps.
        reference_normal: normal of a matte card, in the axes above; without it the reference is a ball.
        reference_radius: radius of a matte ball [m], needed for near lamps.
        mirror: reflectance of the chrome balls, one number or one per channel: intensities from highlights that are
            not clipped. If it is unknown give 1: the ratios of intensities are still right.
        object: mask of the object itself, instead of a chrome ball: directions and relative intensities of five or more
            lamps by self-calibration, with standard errors. The object is assumed convex at its outline.
        transfer: transfer curve of 8-bit photographs, for intensities or an object; 16 bits are assumed linear.
    """
    from hagoromo.app.calibration_report import lamp_summary, object_summary

    if object is not None and (mask or moved or mirror or reference):
        raise InputError("--object replaces --mask, --moved, --mirror and --reference: give either it or those")
    if bool(reference) != bool(reflectance):
        raise InputError("--reference (a mask) and --reflectance go together: give both or none")
    replaceable_file(out, force)
    with progress_bar("calibrate lamps") as progress:
        if object is not None:
            result = hg.calibrate_lamps_from_object(
                photographs, object, camera=camera, transfer=transfer, progress=progress
            )
        else:
            matte = None
            if reference is not None:
                matte = hg.MatteReference(reference, reflectance, reference_normal, reference_radius)
            result = hg.calibrate_lamps(
                photographs, mask, moved=moved, radius=radius, camera=camera, reference=matte, mirror=mirror,
                transfer=transfer, progress=progress,
            )  # fmt: skip
    result.save(out, force)
    summary = object_summary(result) if isinstance(result, hg.SelfCalibration) else lamp_summary(result)
    say(*summary)
    wrote(out)


@verb(calibrations, "rig")
def calibrate_rig(
    captures: Positional[tuple[Path, ...]],
    out: Out,
    card: bool = False,
    normal: tuple[float, float, float] | None = None,
    distance: float | None = None,
    force: Force = False,
) -> None:
    """Captures under the same lamps, a photograph each → rig.json: how strong the lamps are beside one another, and
    how their light falls off over the picture.

    `measure --rig` and `relight --rig` divide the photographs of other objects in the same place by it.

    Args:
        captures: folders with transforms.json, of any object whose shape can be solved, or of a flat card.
        card: the captures show a flat matte card, in the mask.
        normal: direction that the card faces, in the world's axes (default: to the camera), to 1 degree.
        distance: from the camera to an object [m] (default: to the world's origin).
    """
    from hagoromo.app.calibration_report import rig_summary

    replaceable_file(out, force)
    with progress_bar("calibrate rig") as progress:
        rig = hg.calibrate_rig(captures, card=card, normal=normal, distance=distance, progress=progress)
    rig.save(out, force)
    say(*rig_summary(rig))
    wrote(out)


@verb(calibrations, "response", response_files)
def calibrate_response(
    sources: Positional[tuple[Path, ...]],
    out: Out,
    lamp: tuple[str, ...] = (),
    chart: str = "BabelColor Average",
    corners: tuple[float, ...] = (),
    force: Force = False,
) -> None:
    """Known spectra and the camera's readings of them, or photographs of a chart → spectral sensitivities.

    Args:
        sources: CSV with a row per spectrum: its values in columns named by wavelength [nm], the readings in the other
            columns, and in a column lamp, if there is one, the number of the lamp, whose strength may be wrong; or
            linear photographs of a chart of 24 patches: developed EXR, or 16-bit PNG of one exposure.
        lamp: spectrum of the lamp of each photograph, a name or CSV, all in one unit.
        chart: spectra of the patches: a chart of colour-science, or a CSV with a column per patch.
        corners: x y of the chart's corners [px], clockwise from that of the first patch, if it is not detected.
    """
    from hagoromo.app.calibration_report import response_plot

    targets = response_files(out).files
    replaceable_files(targets, force)
    calibration = _response(sources, lamp, chart, corners)
    with whole_files(targets, force) as partials:
        calibration.save(partials[0])
        partials[-1].write_bytes(response_plot(calibration))
    if calibration.noise.max() > DOUBTFUL_NOISE:
        warnings.warn(
            f"the known spectra explain the readings only to {100 * calibration.noise.max():.0f} %: check that the "
            "readings are linear in light and free of glare, that each spectrum belongs to its reading, and that a "
            "column lamp says which readings are of one lamp",
            stacklevel=2,
        )
    for channel, residual, noise in zip(
        calibration.response.channels, calibration.residual, calibration.noise, strict=True
    ):
        print(f"{channel}: residual {100 * residual:.2f} % of the mean reading, noise {100 * noise:.2f} %")
    for remark in calibration.remarks():
        say(remark)
    wrote(*targets)


def board_of(
    corners: str, square: float, marker: float = 0.0, dictionary: str = "4X4_50", window: int | None = None
) -> hg.Board:
    """The board of a command line: corners such as "9x6"."""
    match = re.fullmatch(r"(\d+)x(\d+)", corners)
    if match is None:
        raise InputError(f"--board is {corners!r}: give inner corners as columns x rows, such as 9x6")
    return hg.Board(int(match[1]), int(match[2]), square, marker, dictionary, window)


def _response(
    sources: Sequence[Path], lamps: Sequence[str], chart: str, corners: Sequence[float]
) -> hg.ResponseCalibration:
    if not lamps:
        if len(sources) != 1 or sources[0].suffix.lower() != ".csv":
            raise InputError("give one CSV of pairs, or photographs of a chart with a --lamp for each")
        return hg.calibrate_response(sources[0])
    if corners and len(corners) != 8 * len(sources):
        asked = f"{len(sources)} photographs have {8 * len(sources)}"
        raise InputError(f"--corners has {len(corners)} numbers: {asked}, give x and y of four corners for each")
    import numpy as np

    places = list(np.reshape(corners, (len(sources), 4, 2))) if corners else None
    return hg.response_from_chart(sources, lamps, chart, places)
