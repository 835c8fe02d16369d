"""Pictures of the report: photographs in sRGB, labels and residuals; and the residuals of the fit."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response, srgb_from_camera
from hagoromo.files.plot import panels
from hagoromo.measurement.material.segment import interior
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.observations import Pixels, known_shape, native
from hagoromo.measurement.sight import sight_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo_page.report.display import exposure, shown
from hagoromo_page.report.page import page_picture

MATERIAL_COLOURS = {"skin": "#b5651d", "cloth": "#2f5d9b", "feather": "#8a8a8a", "dielectric": "#3b7d5a"}
FULL_COLOUR_SIGMAS = 5.0  # standard deviations at which a residual is fully red or blue
UNKNOWN = (235, 235, 232)
MAP_WIDTH_INCH = 4.6  # inch, of a map
DPI = 130


def response_of(photograph: Photograph) -> Response:
    """The response of the camera, which is known for all captures of the demo."""
    assert photograph.camera.response is not None
    return photograph.camera.response


def developed(photograph: Photograph, values: NDArray | None = None) -> NDArray[np.uint8]:
    """sRGB picture of the photograph, or of other `values` at the photograph's exposure."""
    matrix = srgb_from_camera(response_of(photograph), photograph.lamps[0].spectrum)
    scale = exposure(photograph.values @ matrix.T)
    return shown(photograph.values if values is None else np.nan_to_num(values), matrix, scale)


def around(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """Rows and columns of the true pixels, with a margin of a twelfth of their height."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    edge = (rows[-1] - rows[0]) // 12 + 1
    return slice(max(rows[0] - edge, 0), rows[-1] + edge), slice(max(columns[0] - edge, 0), columns[-1] + edge)


def labels(measurement: Measurement) -> NDArray[np.uint8]:
    """Picture of the labels in the colours of the plots."""
    colours = [MATERIAL_COLOURS.get(material.name, "#000000") for material in measurement.materials]
    table = np.array([[int(colour[k : k + 2], 16) for k in (1, 3, 5)] for colour in colours] + [UNKNOWN], np.uint8)
    return table[measurement.labels]


def residual(standardised: NDArray) -> NDArray[np.uint8]:
    """Mean residual of the channels of (height, width, channels): white at 0, red above, blue below, grey unknown."""
    mean = standardised.mean(axis=2)
    strength = np.clip(np.nan_to_num(mean) / FULL_COLOUR_SIGMAS, -1.0, 1.0)
    fading = 1.0 - np.abs(strength)
    picture = np.stack([np.where(strength > 0, 1.0, fading), fading, np.where(strength < 0, 1.0, fading)], axis=2)
    return np.where(np.isnan(mean)[..., None], np.array(UNKNOWN, np.uint8), np.rint(255.0 * picture).astype(np.uint8))


def fitted_residuals(capture: Capture, measurement: Measurement) -> NDArray:
    """Residuals (n,) that were open to the fit: measured by the sensor itself, lit and seen beyond grazing, inside."""
    inside = [interior(measurement.labels, number) for number in range(len(measurement.materials))]
    pixels, residuals = Pixels.where(capture, known_shape(capture) & np.any(inside, axis=0)), []
    for photograph, standardised in zip(capture.photographs, measurement.residuals, strict=True):
        used = sight_of(photograph, pixels.points, pixels.normals).fit_to_use
        place = pixels.rows[used], pixels.columns[used]
        values, own = standardised[place], native(photograph)[place]
        residuals.append(values[own & np.isfinite(values)])
    return np.concatenate(residuals)


def map_picture(
    values: NDArray[np.float64],
    mask: NDArray[np.bool_],
    crop: tuple[slice, slice],
    colours: str,
    limits: tuple[float, float],
    unit: str,
    title: str,
) -> str:
    """An <img> of a map with its colour bar, in pixels of the photograph."""
    from matplotlib import colormaps

    rows, columns = crop
    rows, columns = (slice(s.start, min(s.stop, size)) for s, size in zip((rows, columns), mask.shape, strict=True))
    height = MAP_WIDTH_INCH * (rows.stop - rows.start) / (columns.stop - columns.start)
    figure, (axis,) = panels(1, MAP_WIDTH_INCH, min(max(0.78 * height + 0.75, 1.5), 8.0))
    palette = colormaps[colours].with_extremes(bad="#d8d8d4")
    shown = np.where(mask, values, np.nan)[rows, columns]
    extent = (columns.start, columns.stop, rows.stop, rows.start)
    drawn = axis.imshow(shown, cmap=palette, vmin=limits[0], vmax=limits[1], extent=extent, interpolation="nearest")
    axis.set_title(title, fontsize=9)
    axis.set_xlabel("x [px]", fontsize=8)
    axis.set_ylabel("y [px]", fontsize=8)
    bar = figure.colorbar(drawn, ax=axis, extend="max" if limits[0] == 0.0 else "both", shrink=0.9)
    bar.set_label(unit, fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return page_picture(rasterised(figure), f"map in {unit}: {title}", lossless=True)


def rasterised(figure: Any) -> NDArray[np.uint8]:
    """The pixels (h, w, 3) of a figure."""
    import cv2

    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI)
    picture = cv2.imdecode(np.frombuffer(drawn.getvalue(), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture[..., ::-1], np.uint8)
