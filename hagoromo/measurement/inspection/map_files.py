"""Files of inspection maps: EXR with the values, PNG to look at with a scale below, and their record."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import write_json
from hagoromo.measurement.inspection.maps import InspectionMaps
from hagoromo.measurement.inspection.stretch import SHOWN_DEVIATIONS
from hagoromo.photograph.pixels import default_channels

RECORD = "maps.json"
LEAST_WIDTH = 480  # px of a picture; smaller ones are shown with pixels as many times as wide
STRIP_INCH, DPI = 0.5, 100  # height of the scale
BENT_PERCENTILE, OPEN_PERCENTILE = 98.0, 1.0  # of the pixels, that the scales of curvature and occlusion hold
LEAST_BENT = 1e-6  # of the unit: the scale of a plane
UNKNOWN = (0.85, 0.85, 0.83)  # colour of what is unknown
BENT_COLOURS, OPEN_COLOURS = "RdBu_r", "gray"
STEP = 0.05  # of the sky: to which the darkest end of the scale is rounded
Array = NDArray[np.float64]


def write_maps(maps: InspectionMaps, home: Path) -> None:
    """Write the files that `InspectionMaps.write_into` lists."""
    known, bent = maps.known.astype(np.float32), maps.curvature
    unit = f"1/{bent.unit}"
    channels = {"curvature": np.nan_to_num(bent.value), "known": np.isfinite(bent.value).astype(np.float32)}
    if bent.error is not None:
        channels["error.curvature"] = np.nan_to_num(bent.error)
    write_exr(home / "curvature.exr", channels, {"comment": f"mean curvature [{unit}], positive where it bulges"})
    write_exr(home / "occlusion.exr", {"occlusion": np.nan_to_num(maps.occlusion), "known": known})
    write_png(home / "curvature.png", curvature_picture(maps))
    write_png(home / "occlusion.png", occlusion_picture(maps))
    if maps.stretch is not None:
        value = maps.stretch.value
        layers = dict(zip(default_channels(value.shape[2]), np.moveaxis(np.nan_to_num(value), 2, 0), strict=True))
        write_exr(home / "stretch.exr", layers | {"known": known}, {"comment": "colours in standard deviations"})
        write_png(home / "stretch.png", stretch_picture(maps))
    write_json(home / RECORD, maps.record())


def end_of_curvature(value: Array) -> float:
    """Curvature at the ends of the scale of a map, one digit."""
    bent = np.abs(value[np.isfinite(value)])
    if not len(bent):
        return 1.0
    found = max(float(np.percentile(bent, BENT_PERCENTILE)), LEAST_BENT)
    power = 10.0 ** np.floor(np.log10(found))
    return float(power * np.ceil(found / power - 1e-9))


def end_of_occlusion(value: Array) -> float:
    """Share of the sky at the dark end of the scale of a map."""
    darkest = float(np.nanpercentile(value, OPEN_PERCENTILE))
    return max(min(STEP * np.floor(darkest / STEP), 1.0 - STEP), 0.0)


def curvature_picture(maps: InspectionMaps) -> NDArray[np.uint8]:
    """(H, w, 3) grooves blue, ridges red, flat white."""
    limit = end_of_curvature(maps.curvature.value)
    label = f"mean curvature [1/{maps.curvature.unit}]: grooves below 0, ridges above"
    return in_scale(maps.curvature.value, BENT_COLOURS, (-limit, limit), label)


def occlusion_picture(maps: InspectionMaps) -> NDArray[np.uint8]:
    """(H, w, 3) white where the whole sky is open."""
    return in_scale(
        maps.occlusion, OPEN_COLOURS, (end_of_occlusion(maps.occlusion), 1.0), "share of the sky that is open"
    )


def stretch_picture(maps: InspectionMaps) -> NDArray[np.uint8]:
    """(H, w, 3) the stretched colours."""
    assert maps.stretch is not None
    label = f"standard deviations of each channel (0: ± {SHOWN_DEVIATIONS:g} from black to full)"
    limits = -SHOWN_DEVIATIONS, SHOWN_DEVIATIONS
    picture = np.where(maps.known[..., None], maps.stretch.shown, np.uint8(np.rint(255 * UNKNOWN[0])))
    return with_scale(picture.astype(np.uint8), OPEN_COLOURS, limits, label)


def in_scale(values: Array, colours: str, limits: tuple[float, float], label: str) -> NDArray[np.uint8]:
    """A picture (H, W, 3) of `values` (h, w), NaN grey, with its scale below; pixels stay where they are."""
    from matplotlib import colormaps

    palette = colormaps[colours].with_extremes(bad=UNKNOWN)
    share = (values - limits[0]) / (limits[1] - limits[0])
    coloured = palette(np.ma.masked_invalid(np.clip(share, 0.0, 1.0)))[..., :3]
    return with_scale(np.rint(255.0 * coloured).astype(np.uint8), colours, limits, label)


def with_scale(picture: NDArray[np.uint8], colours: str, limits: tuple[float, float], label: str) -> NDArray[np.uint8]:
    """A picture with a bar of its colours below; a small one has larger pixels, a whole number of times."""
    times = max(-(-LEAST_WIDTH // picture.shape[1]), 1)
    large = picture.repeat(times, axis=0).repeat(times, axis=1)
    strip = _strip(large.shape[1], colours, limits, label)
    return np.concatenate([large, strip[:, : large.shape[1]]], axis=0)


def _strip(width: int, colours: str, limits: tuple[float, float], label: str) -> NDArray[np.uint8]:
    """(h, width, 3) a horizontal colour bar with its numbers and label."""
    from matplotlib import colormaps
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width / DPI, STRIP_INCH), dpi=DPI)
    axis = figure.add_axes((0.06, 0.62, 0.88, 0.28))
    drawn: Any = ScalarMappable(Normalize(*limits), colormaps[colours])
    bar = figure.colorbar(drawn, cax=axis, orientation="horizontal")
    bar.ax.tick_params(labelsize=7, length=2, pad=1)
    bar.set_label(label, fontsize=7.5, labelpad=1)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    shown = np.asarray(canvas.buffer_rgba())[..., :3]
    strip = np.full((shown.shape[0], width, 3), 255, np.uint8)
    columns = min(width, shown.shape[1])
    strip[:, :columns] = shown[:, :columns]
    return strip
