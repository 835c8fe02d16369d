"""Calibrate a camera: photographs of a board → focal length, principal point, distortion with standard deviations.

OpenCV detects the corners and fits the lens (Zhang 2000, "A flexible new technique for camera calibration"). OpenCV's
origin is the centre of the first pixel, ours the corner of the image, so all image points are shifted by ½ px.

Corner choice: which windows of the sub-pixel search suit the photographs of a board.

The windows of `corner_windows` hold no other edges; blur wider than them hides the corner from them. So corners are
sought in other windows, too. Whole sets of windows are compared by photographs that were left out of the fit, and the
photographs that fit worst take the windows with the least residual.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.camera.board import OWN_WINDOWS, Board, Corners
from hagoromo.calibration.opencv_threads import one_thread
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import CameraRecord, read_camera
from hagoromo.camera.lens import COEFFICIENTS
from hagoromo.errors import InputError
from hagoromo.files.picture import by_name, read_picture
from hagoromo.files.record import decode, read_json, save_json, written_by
from hagoromo.least_squares.loss import robust_scale
from hagoromo.progress import Progress, silent

Model = Literal[0, 2, 4, 5, 8]  # number of fitted distortion coefficients, in OpenCV's order
NAMES = ("fl_x", "fl_y", "cx", "cy", *COEFFICIENTS)
FEWEST_BOARDS = 3  # least number of planes that determine focal length and principal point (Zhang 2000)
OTHER_FOCAL = 1.2  # a focal length longer or shorter by this factor must increase the rms
WORSE_FIT = 1.1  # by this factor; it does not if all boards are parallel (Zhang 2000)
OUTLIER_SIGNIFICANCE = 3.5  # robust standard deviations of a view's log rms above the median (Iglewicz & Hoaglin 1993)
FOLDS = 4  # groups of photographs that are left out, one after the other
FEWEST_TO_LEAVE_OUT = 8  # photographs; of fewer, the residuals of the fit itself are compared
FEWEST_TO_FIT = 3  # photographs that determine a lens
BETTER = 0.98  # least gain of other windows over our own: rms of the photographs left out
Lens = tuple[NDArray[np.float64], NDArray[np.float64]]  # matrix and distortion
Fit = Callable[[Sequence[Corners]], Lens]
Named = Mapping[str, Mapping[str, Corners]]  # windows → photograph → corners


@dataclass(frozen=True, eq=False)
class CameraCalibration:
    """A calibrated camera and how well it is known.

    standard_deviation: of each fitted parameter of `NAMES` [px; distortion: dimensionless]. rms: root mean square
    length of the corners' residuals [px]. boards: rms per used photograph [px]. skipped: photographs in which no board
    was detected. outliers: used photographs that fit much worse than the others. corners, residuals: per used
    photograph, (n, 2) image points (x, y), and measured minus predicted points [px].
    settings: those of `calibrate_camera`; with `windows`, in which corners were sought, and `left_out_rms_px`, by which
    these were chosen: of photographs left out of the fit.
    """

    camera: Camera
    standard_deviation: dict[str, float]
    rms: float
    boards: dict[str, float]
    skipped: tuple[str, ...]
    outliers: tuple[str, ...]
    corners: dict[str, NDArray[np.float64]]
    residuals: dict[str, NDArray[np.float64]]
    settings: Mapping[str, Any] = field(default_factory=dict)

    def __repr__(self) -> str:
        """The residual and the focal length."""
        width = self.standard_deviation.get("fl_x", 0.0)
        return (
            f"CameraCalibration(rms {self.rms:.3f} px over {len(self.boards)} photographs, "
            f"focal length {self.camera.focal[0]:.2f} ± {width:.2f} px)"
        )

    def record(self) -> dict[str, Any]:
        """The JSON record: keys of nerfstudio's `transforms.json`, then their uncertainty."""
        camera = self.camera
        values = (*camera.focal, *camera.principal, *camera.distortion)
        return {
            "w": camera.width,
            "h": camera.height,
            **dict(zip(NAMES, values, strict=True)),
            "standard_deviation": self.standard_deviation,
            "rms_px": self.rms,
            "boards_rms_px": self.boards,
            "skipped": list(self.skipped),
            "outliers": list(self.outliers),
            "hagoromo": written_by(self.settings),
        }

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write camera.json, which `read_camera` reads; `InputError` where it exists without `force`."""
        return save_json(path, self.record(), force)

    @staticmethod
    def load(path: str | Path) -> CameraCalibration:
        """The calibration that `save` wrote; the file holds no corners and residuals, so they are empty."""
        record = decode(read_json(path), CameraRecord, str(path))
        if record.rms_px is None:
            raise InputError(f"{path} lacks the key 'rms_px': give a camera.json of `calibrate camera`")
        errors, boards = record.standard_deviation, record.boards_rms_px
        return CameraCalibration(
            read_camera(path), errors, record.rms_px, boards, record.skipped, record.outliers, {}, {},
            record.hagoromo.settings,
        )  # fmt: skip


def calibrate_camera(
    photographs: Sequence[str | Path] | Mapping[str, NDArray],
    board: Board,
    coefficients: Model = 5,
    square_pixels: bool = False,
    progress: Progress = silent,
) -> CameraCalibration:
    """Fit a camera to photographs of a board.

    photographs: three or more files (PNG, JPEG or TIFF), or name → (height, width) or (height, width, 3), 8 or 16 bits
    or float; all of one size. coefficients: number of fitted distortion coefficients, the others are 0: none; k1 k2;
    also p1 p2; also k3; also k4 k5 k6. square_pixels: fit one focal length. `InputError` for photographs of different
    sizes, fewer than three detected boards, or boards (such as parallel ones) that do not determine the camera.
    """
    if not isinstance(photographs, Mapping):
        photographs = {name: read_picture(path) for name, path in by_name([Path(p) for p in photographs]).items()}
    _check(photographs)
    sets: dict[str, dict[str, Corners]] = {}
    for count, (name, photograph) in enumerate(photographs.items()):
        progress(count / len(photographs), name)
        for windows, board_corners in (board.find_by_windows(photograph) or {}).items():
            sets.setdefault(windows, {})[name] = board_corners
    corners = sets.get(OWN_WINDOWS, {})
    skipped = tuple(name for name in photographs if name not in corners)
    if len(corners) < FEWEST_BOARDS:
        raise InputError(
            f"a {board} was found in {len(corners)} of {len(photographs)} photographs and {FEWEST_BOARDS} are needed: "
            "check board (--board), or take more photographs"
        )
    height, width = next(iter(photographs.values())).shape[:2]
    size, flags = (width, height), _flags(coefficients, square_pixels)
    with one_thread():
        chosen = _chosen(sets, size, flags) if len(sets) > 1 else Chosen(corners, OWN_WINDOWS, {})
        calibration = _fit(chosen.corners, skipped, size, flags)
    stated = {
        "board": asdict(board), "coefficients": coefficients, "square_pixels": square_pixels,
        "windows": chosen.windows, "left_out_rms_px": chosen.left_out,
    }  # fmt: skip
    return replace(calibration, settings=stated)


def _check(photographs: Mapping[str, NDArray]) -> None:
    sizes = {name: photograph.shape[:2] for name, photograph in photographs.items()}
    first = next(iter(sizes), "")
    for name, size in sizes.items():
        if size != sizes[first]:
            raise InputError(
                f"photographs of different sizes: {first} is {sizes[first][1]}x{sizes[first][0]} px and {name} "
                f"{size[1]}x{size[0]}: calibrate each size by itself"
            )


def _flags(coefficients: Model, square_pixels: bool) -> int:
    import cv2

    fixed = {
        0: (cv2.CALIB_FIX_K1, cv2.CALIB_FIX_K2, cv2.CALIB_ZERO_TANGENT_DIST, cv2.CALIB_FIX_K3),
        2: (cv2.CALIB_ZERO_TANGENT_DIST, cv2.CALIB_FIX_K3),
        4: (cv2.CALIB_FIX_K3,),
        5: (),
        8: (cv2.CALIB_RATIONAL_MODEL,),
    }
    if coefficients not in fixed:
        raise InputError(f"a lens of {coefficients} coefficients: choose 0, 2, 4, 5 or 8")
    return sum(fixed[coefficients]) + (cv2.CALIB_FIX_ASPECT_RATIO if square_pixels else 0)


def _fit(
    corners: Mapping[str, Corners], skipped: tuple[str, ...], size: tuple[int, int], flags: int
) -> CameraCalibration:
    import cv2

    points, image = ([getattr(one, what) for one in corners.values()] for what in ("points", "image"))
    rms, matrix, distortion, rotations, shifts, deviations, _, errors = cv2.calibrateCameraExtended(
        points, image, size, np.eye(3), np.zeros(8), flags=flags
    )
    deviation = dict(zip(NAMES, map(float, deviations.ravel()), strict=False))
    if flags & cv2.CALIB_FIX_ASPECT_RATIO:
        deviation["fl_x"] = deviation["fl_y"]  # OpenCV fits fl_y only and derives fl_x
    best, *others = (_rms_at(focal, points, image, size, matrix) for focal in (1.0, OTHER_FOCAL, 1.0 / OTHER_FOCAL))
    if not (np.isfinite([rms, *deviation.values()]).all() and min(others) > WORSE_FIT * best):
        raise InputError(
            f"the photographs of the board do not determine the camera (a focal length {OTHER_FOCAL:g} times as long "
            f"or short fits to {min(others):.3g} px, the best to {best:.3g} px): tilt the board more between them"
        )
    camera = Camera(
        *size,
        focal=(float(matrix[0, 0]), float(matrix[1, 1])),
        principal=(float(matrix[0, 2]) + 0.5, float(matrix[1, 2]) + 0.5),
        distortion=tuple(map(float, distortion.ravel()[:8])),
    )
    within = camera.unproject(np.concatenate([one.image for one in corners.values()]) + 0.5)
    if np.isnan(within).any():
        raise InputError(
            "the fitted lens folds the image over itself within the boards: fit fewer coefficients (--coefficients)"
        )
    predicted = [
        cv2.projectPoints(p, r, t, matrix, distortion)[0].reshape(-1, 2)
        for p, r, t in zip(points, rotations, shifts, strict=True)
    ]
    boards = dict(zip(corners, map(float, errors.ravel()), strict=True))
    return CameraCalibration(
        camera,
        {name: spread for name, spread in deviation.items() if spread > 0.0},
        float(rms),
        boards,
        skipped,
        _outliers(boards, np.array([len(one.image) for one in corners.values()])),
        {name: one.image.astype(np.float64) + 0.5 for name, one in corners.items()},
        {
            name: np.asarray(one.image - expected, np.float64)
            for (name, one), expected in zip(corners.items(), predicted, strict=True)
        },
    )


def _chosen(sets: Mapping[str, Mapping[str, Corners]], size: tuple[int, int], flags: int) -> Chosen:
    """The corners by the windows that suit the photographs best."""
    import cv2

    def lens(corners: Sequence[Corners]) -> Lens:
        points, image = ([getattr(one, what) for one in corners] for what in ("points", "image"))
        fitted = cv2.calibrateCamera(points, image, size, np.eye(3), np.zeros(8), flags=flags)
        return np.asarray(fitted[1], np.float64), np.asarray(fitted[2], np.float64)

    def odd(corners: Mapping[str, Corners]) -> tuple[str, ...]:
        found = lens(list(corners.values()))
        rms = {name: residual(one, found) for name, one in corners.items()}
        return _outliers(rms, np.array([len(one.image) for one in corners.values()]))

    return chosen_corners(sets, lens, odd)


def _rms_at(factor: float, points: list, image: list, size: tuple[int, int], matrix: NDArray) -> float:
    """The rms [px] of the best fit of k1 and k2 with `factor` times the focal length of `matrix`.

    Only two coefficients, because eight can compensate any focal length.
    """
    import cv2

    held = cv2.CALIB_USE_INTRINSIC_GUESS | cv2.CALIB_FIX_FOCAL_LENGTH | _flags(2, False)
    other = matrix * [[factor, 1.0, 1.0], [1.0, factor, 1.0], [1.0, 1.0, 1.0]]
    return float(cv2.calibrateCamera(points, image, size, other, np.zeros(5), flags=held)[0])


def _outliers(boards: Mapping[str, float], counts: NDArray) -> tuple[str, ...]:
    """Photographs whose log rms lies more than OUTLIER_SIGNIFICANCE robust standard deviations above the median.

    The standard deviation is never taken to be less than that of chance alone.
    """
    logs = np.log(np.maximum(list(boards.values()), 1e-12))
    above = logs - np.median(logs)
    chance = 1.0 / np.sqrt(
        2.0 * (2.0 * counts - 6.0)
    )  # of the log of an rms of 2n residuals with 6 fitted pose parameters
    spread = np.maximum(robust_scale(above), chance)
    return tuple(name for name, far in zip(boards, above / spread, strict=True) if far > OUTLIER_SIGNIFICANCE)


class Chosen(NamedTuple):
    """corners: photograph → corners. windows: what they were sought in. left_out: rms [px] by each set of windows."""

    corners: dict[str, Corners]
    windows: str
    left_out: dict[str, float]


def chosen_corners(found: Named, fit: Fit, outliers: Callable[[Mapping[str, Corners]], Sequence[str]]) -> Chosen:
    """The corners with the least residuals in photographs that were left out of the fit.

    fit: corners of photographs → lens. outliers: names of the photographs that fit much worse than the others.
    """
    scores = {name: _left_out(list(corners.values()), fit) for name, corners in found.items()}
    best = min(scores, key=lambda name: scores[name])
    best = best if scores[best] < BETTER * scores[OWN_WINDOWS] else OWN_WINDOWS
    corners = dict(found[best])
    odd = outliers(corners)
    if odd:
        kept = [one for name, one in corners.items() if name not in odd]
        lens = fit(kept if len(kept) >= FEWEST_TO_FIT else list(corners.values()))
        mixed = corners | {
            name: min((others[name] for others in found.values()), key=lambda one: residual(one, lens)) for name in odd
        }
        scores["mixed"] = _left_out(list(mixed.values()), fit)
        if scores["mixed"] < scores[best]:
            return Chosen(mixed, f"{best}; of {', '.join(odd)} those with the least residual", scores)
    return Chosen(corners, best, scores)


def residual(corners: Corners, lens: Lens) -> float:
    """Root mean square length [px] of the residuals of one photograph, its pose fitted."""
    import cv2

    solved, turn, shift = cv2.solvePnP(corners.points, corners.image, *lens)
    if not solved:
        return np.inf
    predicted = cv2.projectPoints(corners.points, turn, shift, *lens)[0].reshape(-1, 2)
    return float(np.sqrt(np.mean(np.sum((corners.image - predicted) ** 2, axis=1))))


def _left_out(corners: Sequence[Corners], fit: Fit) -> float:
    """Root mean square residual [px] of photographs by lenses that were fitted without them."""
    if len(corners) < FEWEST_TO_LEAVE_OUT:
        lens = fit(corners)
        return float(np.sqrt(np.mean([residual(one, lens) ** 2 for one in corners])))
    squares = []
    for fold in range(FOLDS):
        lens = fit([one for k, one in enumerate(corners) if k % FOLDS != fold])
        squares += [residual(one, lens) ** 2 for one in corners[fold::FOLDS]]
    return float(np.sqrt(np.mean(squares)))
