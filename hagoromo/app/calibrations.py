"""The verbs under `hagoromo calibrate`: a camera, its lamps, its spectral response."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, Literal

import tyro
from tyro.conf import Positional

from hagoromo.app.progress import progress_bar
from hagoromo.app.verb import Force, Out, verb, wrote

LAMP = ("name", "to_lamp", "intensity")  # of a lamp in a capture's transforms.json

calibrations = tyro.extras.SubcommandApp()


@verb(calibrations, "camera")
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
    """Photographs of a board → intrinsics, distortion, their standard deviations, rms, a plot of the residuals beside.

    Args:
        photographs: PNG, JPEG or TIFF, all of one size, three or more.
        board: inner corners, columns x rows, such as 9x6.
        square: side of a square [m].
        marker: side of a marker [m] of a ChArUco board; 0 for a chessboard.
        dictionary: OpenCV's name of the markers.
        coefficients: of the lens, fitted: none, k1 k2, p1 p2 too, k3 too, k4 k5 k6 too.
        square_pixels: one focal length for both axes.
        window: half side [px] of the search for a corner (default: a third of the smallest square).
    """
    from hagoromo.app.calibrate_camera import calibrate_to, parse_board

    target = parse_board(board, square, marker, dictionary, window)
    found, written = calibrate_to(_pictures(photographs), target, out, coefficients, square_pixels, force)
    print(f"rms {found.rms:.3f} px over {len(found.boards)} photographs, {len(found.skipped)} without a board")
    for axis, value in zip("xy", found.camera.focal, strict=True):
        print(f"focal length {axis} {value:.2f} ± {found.standard_deviation[f'fl_{axis}']:.2f} px")
    for name in found.outliers:
        print(f"{name}: rms {found.boards[name]:.3f} px, far above the others: look at it, or leave it out")
    wrote(*written)


@verb(calibrations, "lamps")
def calibrate_lamps(
    photographs: Positional[tuple[Path, ...]], mask: Path, out: Out, camera: Path | None = None, force: Force = False
) -> None:
    """Photographs of a chrome ball, one lamp on in each → where the lamps stand, one each.

    Args:
        photographs: PNG or JPEG, one per lamp, all from one place.
        mask: picture that is white on the ball and black elsewhere.
        camera: camera.json of `calibrate camera`, or OpenCV's YAML; without it the view is taken for orthographic.
    """
    from hagoromo.camera.camera_file import read_camera
    from hagoromo.files.picture import read_picture
    from hagoromo.files.record import write_json
    from hagoromo.files.whole import whole_file
    from hagoromo.photograph.lamps import calibrate_lamps

    with whole_file(out, force) as partial, progress_bar("calibrate lamps") as progress:
        lens = None if camera is None else read_camera(camera)
        ball, readings = calibrate_lamps(_pictures(photographs), read_picture(mask), lens, progress)
        records = [reading.record() for reading in readings]
        lamps = [{key: record[key] for key in LAMP} for record in records]  # as a capture lists them
        shape = {"centre_px": ball.centre, "radius_px": ball.radius, "rms_px": ball.rms}
        write_json(partial, {"lamps": lamps, "ball": shape, "readings": records})
    for reading in readings:
        x, y, z = reading.to_lamp
        print(f"{reading.name}: to_lamp ({x:.4f}, {y:.4f}, {z:.4f}), standard error {reading.standard_error_deg:.2f}°")
    wrote(out)


@verb(calibrations, "response")
def calibrate_response(
    sources: Positional[tuple[Path, ...]],
    out: Out,
    lamp: tuple[str, ...] = (),
    chart: str = "BabelColor Average",
    corners: tuple[float, ...] = (),
    force: Force = False,
) -> None:
    """Known spectra and what the camera read of them, or photographs of a chart → spectral sensitivities.

    Args:
        sources: CSV of pairs, a row per spectrum: its values in columns named by wavelength [nm], the readings in the
            others; or linear photographs of a chart of 24 patches: developed EXR, or 16-bit PNG of one exposure.
        lamp: spectrum of the lamp of each photograph, a name or CSV, all in one unit.
        chart: spectra of the patches: a chart of colour-science, or a CSV with a column per patch.
        corners: x y of the chart's corners [px], clockwise from the first patch's, where the chart is not found.
    """
    from hagoromo.app.calibrate_response import ChartSetting, calibrate_response_to

    found, paths = calibrate_response_to(sources, ChartSetting(chart, lamp, corners), out, force)
    for channel, residual, noise in zip(found.response.channels, found.residual, found.noise, strict=True):
        print(f"{channel}: residual {100 * residual:.2f} % of the mean reading, noise {100 * noise:.2f} %")
    wrote(*paths)


def _pictures(paths: Sequence[Path]) -> dict[str, Any]:
    """Name → pixels; a name that two files share is given with its folder."""
    from hagoromo.files.picture import read_picture

    names = [path.name for path in paths]
    return {path.name if names.count(path.name) == 1 else str(path): read_picture(path) for path in paths}
