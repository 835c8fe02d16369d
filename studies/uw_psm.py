"""The photometric-stereo set of the University of Washington as captures: six objects, twelve lamps, a chrome ball.

Assumptions where the set gives no data: the view is nearly orthographic (focal length 1e5 px), a pixel is half a
millimetre, the 8 bits are linear in light (`studies/encoding.py` tests it), and white is the value of a diffuser of
albedo ASSUMED_ALBEDO that faces a lamp. World axes: x right, y up, z to the camera.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

Array = NDArray[np.float64]
OBJECTS = ("gray", "buddha", "cat", "horse", "owl", "rock")
LAMPS = 12
FOCAL = 1e5  # px: from afar, 0.15° between the middle and the edge of the picture
PIXEL = 5e-4  # m: a guess of the right order
ASSUMED_ALBEDO = 1.0 / 3.0  # a gauge, as the lamps' strength is unknown: low, so that all bodies conserve energy
OBJECT_LEVEL = 250  # mask level of a pixel that shows the object only
FULL_WELL, READ_NOISE = 20_000.0, 10.0  # electrons, those of a camera whose file states none
SENSOR = hg.Sensor(
    exposure=FULL_WELL,
    full_well=FULL_WELL,
    read_noise=READ_NOISE,
    gain=FULL_WELL / 255.0,
    black_level=0.0,
    bits=8,
)


def read_lamps(folder: str | Path) -> tuple[hg.Ball, tuple[hg.LampReading, ...]]:
    """The lamps as the chrome ball shows them; `InputError` when its photographs are not in `folder`."""
    home = Path(folder) / "chrome"
    photographs = {f"{k}": hg.read_png(home / f"chrome.{k}.png") for k in range(LAMPS)}
    return hg.lamps_from_ball(photographs, hg.read_png(home / "chrome.mask.png"))


def read_object(folder: str | Path, name: str, lamps: tuple[hg.LampReading, ...]) -> hg.Capture:
    """The capture of one object: twelve photographs, pixels that are wholly on it and not saturated."""
    if name not in OBJECTS:
        raise hg.InputError(f"no object is called {name!r}: choose one of {', '.join(OBJECTS)}")
    home = Path(folder) / name
    on_object = _grey(hg.read_png(home / f"{name}.mask.png")) >= OBJECT_LEVEL
    height, width = on_object.shape
    camera = hg.Camera(width, height, (FOCAL, FOCAL), (width / 2, height / 2), sensor=SENSOR, name="uw_psm")
    camera = camera.look_at((0.0, 0.0, FOCAL * PIXEL), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    photographs = []
    for k, lamp in enumerate(lamps):
        developed = hg.develop_raw(hg.read_png(home / f"{name}.{k}.png"), SENSOR)
        # radiance of a diffuser = albedo · irradiance / π
        light = hg.Lamp(to_lamp=lamp.to_lamp, intensity=np.pi / ASSUMED_ALBEDO, name=lamp.name)
        mask = on_object & developed.valid
        photographs.append(hg.Photograph(developed.values, developed.variance, mask, camera, (light,), f"{name} {k}"))
    return hg.Capture(tuple(photographs), name, Path(folder))


def shrunk(capture: hg.Capture, times: int) -> hg.Capture:
    """The capture with photographs of means over squares of `times` pixels that are valid throughout."""

    def blocks(image: NDArray) -> NDArray:
        rows, columns = (length // times for length in image.shape[:2])
        return image[: rows * times, : columns * times].reshape(rows, times, columns, times, *image.shape[2:])

    photographs = []
    for one in capture.photographs:
        camera, mask = one.camera, np.asarray(blocks(one.mask).all(axis=(1, 3)), np.bool_)
        coarse = camera.resampled(camera.width // times, camera.height // times, (times, times))
        camera = replace(coarse, sensor=camera.sensor)
        values = blocks(np.where(one.mask[..., None], one.values, 0.0)).mean(axis=(1, 3))
        variance = blocks(np.where(one.mask[..., None], one.variance, 1.0)).mean(axis=(1, 3)) / times**2
        values, variance = values.astype(np.float32), variance.astype(np.float32)
        photographs.append(replace(one, values=values, variance=variance, mask=mask, camera=camera))
    return replace(capture, photographs=tuple(photographs))


def sphere_normals(folder: str | Path, name: str = "gray") -> Array:
    """(h, w, 3) normals of the ball in the mask of `name`, seen from afar, 0 beside it: the truth for `gray`."""
    mask = hg.read_png(Path(folder) / name / f"{name}.mask.png")
    ball = hg.find_ball(mask)
    rows, columns = np.mgrid[: mask.shape[0], : mask.shape[1]] + 0.5
    x, y = (columns - ball.centre[0]) / ball.radius, -(rows - ball.centre[1]) / ball.radius
    height = 1.0 - x * x - y * y
    normals = np.stack([x, y, np.sqrt(np.maximum(height, 0.0))], axis=2)
    return np.where(height[..., None] > 0.0, normals, 0.0)


def _grey(mask: np.ndarray) -> np.ndarray:
    return mask if mask.ndim == 2 else mask[..., :3].max(axis=2)
