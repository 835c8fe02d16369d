"""Measured maps: gloss, heights and errors of a measurement as people look at them: in colours, with a scale below.

Enters: an EXR in a folder that `hagoromo measure` wrote. Leaves: pictures in sRGB, 8 bits, see also `pictures`.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.exr import read_exr
from hagoromo.measurement.error_files import UNKNOWN_VARIANCE, VARIANCE
from hagoromo.measurement.inspection.map_files import in_scale
from hagoromo.measurement.inspection.seen_surface import SeenSurface, seen_surface
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.measurement_files import ERROR_PREFIX, colour_channels

BODY, GLOSS, POINTS, OWN_LIGHT = "body.exr", "gloss.exr", "points.exr", "own_light.exr"  # of a measurement
COLOURS = "viridis"
ENDS = 1.0, 99.0  # percentiles of the pixels at the ends of a scale; that of an error starts at 0
LEAST_SPAN = 1e-6  # of a scale, where all pixels are alike
Array = NDArray[np.float64]
Layers = Mapping[str, NDArray[np.floating]]
# By what is added to the name of a file: values (h, w), NaN where unknown, and what they are, with their unit
Maps = dict[str, tuple[Array, str]]


def map_pictures(path: Path) -> Iterator[tuple[str, NDArray[np.uint8]]]:
    """Pictures (H, W, 3) of the maps in a file of a measurement, each with what is added to the name of the file.

    None of another file, and none of a map without a known pixel. `InputError` for a damaged file, and for heights
    whose measurement is not beside them.
    """
    if path.name not in MAPS_OF:
        return
    for name, (values, legend) in MAPS_OF[path.name](path).items():
        known = values[np.isfinite(values)]
        if not len(known):
            continue
        low, high = (float(one) for one in np.percentile(known, ENDS))
        low = 0.0 if name.endswith("error") else low
        yield name, in_scale(values, COLOURS, (low, max(high, low + LEAST_SPAN)), legend)


def height_over_plane(surface: SeenSurface) -> Array:
    """(h, w) height over the plane through the surface [`SeenSurface.unit`], to the camera; NaN where unknown.

    The plane has the least sum of squares along the camera's axis.
    """
    pose = surface.camera.world_to_camera
    x, y, z = (surface.points[surface.known] @ pose[:3, :3].T + pose[:3, 3]).T
    sides = np.stack([x - x.mean(), y - y.mean()])
    slope = np.linalg.lstsq(sides @ sides.T, sides @ (z - z.mean()))[0]
    height = np.full(surface.known.shape, np.nan)
    above = (z.mean() + slope @ sides - z) / np.sqrt(1.0 + slope @ slope)  # the camera's axis points away from it
    height[surface.known] = surface.units_per_metre * above
    return height


def _heights(path: Path) -> Maps:
    measurement = Measurement.load(path.parent)
    surface = seen_surface(measurement)
    unit = surface.unit
    maps = {"height": (height_over_plane(surface), f"height over the mean plane, to the camera [{unit}]")}
    if measurement.distance_variance is not None:
        error = surface.units_per_metre * _deviation(measurement.distance_variance)
        known = np.where(surface.known, error, np.nan)
        maps["error"] = (known, f"standard error of the distance to the camera [{unit}]")
    return maps


def _body_error(path: Path) -> Maps:
    layers = read_exr(path)[0]
    names = colour_channels({name for name in layers if "." not in name})
    if not names or not {ERROR_PREFIX + name for name in names} <= set(layers):
        return {}
    value, error = (np.mean([_exact(layers[prefix + one]) for one in names], axis=0) for prefix in ("", ERROR_PREFIX))
    percent = 100.0 * np.divide(error, value, out=np.full(value.shape, np.nan), where=value > 0.0)
    return {"error": (percent, "standard error of the body colour, mean of the channels [%]")}


def _gloss(path: Path) -> Maps:
    layers = read_exr(path)[0]
    if not {"beta", "gamma"} <= set(layers):
        return {}
    known = layers["beta"] > 0.0
    legends = {
        "beta": "β, strength of the gloss [1/sr]", "gamma": "γ, roughness: the width of the facets' slopes [rad]",
        "error.beta": "standard error of β [1/sr]", "error.gamma": "standard error of γ [rad]",
    }  # fmt: skip
    maps = {
        "_".join(name.split(".")[::-1]): (np.where(known, _exact(layers[name]), np.nan), legend)
        for name, legend in legends.items()
        if name in layers
    }
    if "nu" in layers:
        nu = _exact(layers["nu"])
        tail = np.divide(1.0, nu, out=np.zeros(nu.shape), where=nu > 0.0)
        maps["tail"] = np.where(known, tail, np.nan), "1/ν, tails of the facets' slopes (0: none)"
    return maps


def _normal_error(path: Path) -> Maps:
    layers = read_exr(path)[0]
    if "normal" not in layers:
        return {}
    return {"normal_error": (np.degrees(_deviation(layers["normal"])), "standard error of the normals [°]")}


def _own_light(path: Path) -> Maps:
    layers = read_exr(path)[0]
    if not {"share", "most"} <= set(layers):
        return {}
    known = layers["most"] > 0.0
    return {"share": (np.where(known, _exact(layers["share"]), np.nan), "share of light from the object itself")}


MAPS_OF: dict[str, Callable[[Path], Maps]] = {
    BODY: _body_error, GLOSS: _gloss, POINTS: _heights, VARIANCE: _normal_error, OWN_LIGHT: _own_light,
}  # fmt: skip


def _exact(values: NDArray[np.floating]) -> Array:
    return np.asarray(values, np.float64)


def _deviation(variance: NDArray[np.floating]) -> Array:
    """Square root; NaN where a variance is unknown."""
    known = np.isfinite(variance) & (variance < UNKNOWN_VARIANCE)
    return np.sqrt(np.where(known, variance, np.nan).astype(np.float64))
