"""The page of a relit object: photograph, predictions, differences and ΔE00 maps with their scales, figures."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo import __version__
from hagoromo.app.page import Page, image
from hagoromo.app.relight.relit import PREDICTIONS, RIM, Relit
from hagoromo.light.colour import delta_e_2000, srgb_encode
from hagoromo_figures.demo.plots import panels
from hagoromo_figures.demo.report_pictures import around

HEAD = ("photograph", "prediction", "relative rmse", "ΔE00, mean", "ΔE00, 95 %", "PSNR [dB]", "SSIM", "pixels")
WIDTH = 4.6  # inch, of a map
DPI = 130
SHOWN = 95  # percentile of a map that its scale holds
WIDE = 320  # px, of a small photograph on the page


def write_relight_page(path: Path, name: str, measured: int, found: Sequence[Relit]) -> None:
    """Write the page to `path`. measured: number of photographs that the surface was measured from."""
    lead = f"Measured from {measured} photographs, predicted where it was not, by Hagoromo {__version__}."
    page = Page(f"{name or 'Object'}, relit", lead)
    page.section(
        "What this is",
        "The photographs below were kept aside. From the others the surface, its normals and its reflectance were "
        "measured; the surface was filled with matter as volume boxes, and these were rendered under the lamp and "
        "through the camera of each photograph, shadows included. Beside them stands the same reflectance on the same "
        "normals, computed in the picture alone, without shadows.",
        f"Compared is where the surface was measured and covers the pixel, but for {RIM} px along its edge. White is "
        "the level that 1 % of the photograph's pixels exceed. The figures are those of <code>hagoromo compare "
        "predicted_NN.exr photograph_NN.exr --mask mask_NN.png --peak 1</code>, and <code>hagoromo render "
        "scene_NN.toml</code> repeats the rendering; all files lie beside this page.",
    )
    page.table("Predictions against photographs.", HEAD, [row for one in found for row in _rows(one)])
    for one in found:
        _photograph(page, one)
    page.section("Limits")
    page.bullets(
        [
            "Light that one part of the surface throws onto another, or that passes under it, is not predicted.",
            "Shadows that one part throws onto another end a voxel too early, as counted across the surface, and as "
            "softly (a voxel is a pixel of the photographs that were measured).",
            "The boxes hold what the camera of the measured photographs saw; other views see them end at its edges.",
            "Where the camera's response is not known the values of its channels are shown, and compared, as if they "
            "were linear sRGB.",
        ]
    )
    path.write_text(page.html(), encoding="utf-8")


def _rows(one: Relit) -> list[list[str]]:
    rows = []
    for key, found in one.compared.items():
        worst = np.percentile(_delta_e(one, key)[one.mask], 95)
        psnr = "∞" if found["psnr"] is None else f"{found['psnr']:.1f}"
        figures = [f"{100 * found['relative_rmse']:.1f} %", f"{found['delta_e_2000']:.2f}", f"{worst:.2f}", psnr]
        rows.append([escape(one.name), PREDICTIONS[key], *figures, f"{found['ssim']:.3f}", str(found["pixels"])])
    return rows


def _photograph(page: Page, one: Relit) -> None:
    crop = around(one.mask)
    page.section(escape(one.name), f"Lamp: {escape('; '.join(one.lamps))}.")
    shown = [image(_enlarged(one.photograph[crop]), "photograph, kept aside", lossless=True)]
    shown += [image(_enlarged(view[crop]), PREDICTIONS[key], lossless=True) for key, view in one.predictions.items()]
    page.figure("What was photographed and what was predicted, at one exposure.", *shown)
    differences = {key: (view - one.photograph).mean(axis=2) for key, view in one.predictions.items()}
    limit = _nice(max(np.percentile(np.abs(d[one.mask]), SHOWN) for d in differences.values()))
    page.figure(
        "Prediction − photograph, mean of the three channels, in % of white; grey is not compared.",
        *(
            _map(100.0 * difference, one.mask, crop, "RdBu_r", (-100 * limit, 100 * limit), "% of white", key)
            for key, difference in differences.items()
        ),
    )
    colours = {key: _delta_e(one, key) for key in one.predictions}
    limit = _nice(max(np.percentile(d[one.mask], SHOWN) for d in colours.values()))
    page.figure(
        "Colour difference ΔE00 (1 is about what an eye can just tell); grey is not compared.",
        *(_map(colour, one.mask, crop, "magma", (0.0, limit), "ΔE00", key) for key, colour in colours.items()),
    )


def _enlarged(linear: NDArray[np.float64]) -> NDArray[np.uint8]:
    """As people see it, each pixel repeated until the picture is WIDE pixels wide or nearly so."""
    times = max(round(WIDE / linear.shape[1]), 1)
    return srgb_encode(linear).repeat(times, axis=0).repeat(times, axis=1)


def _delta_e(one: Relit, key: str) -> NDArray[np.float64]:
    a, b = (np.clip(values, 0.0, None) for values in (one.predictions[key], one.photograph))
    return np.where(one.mask, delta_e_2000(a, b), 0.0)


def _nice(value: float) -> float:
    """1, 2 or 5 times a power of ten, at least `value`."""
    power = 10.0 ** math.floor(math.log10(max(value, 1e-6)))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value)


def _map(
    values: NDArray[np.float64],
    mask: NDArray[np.bool_],
    crop: tuple[slice, slice],
    colours: str,
    limits: tuple[float, float],
    unit: str,
    key: str,
) -> str:
    """An <img> of a map with its colour bar, in pixels of the photograph."""
    from matplotlib import colormaps

    rows, columns = crop
    rows, columns = (slice(s.start, min(s.stop, size)) for s, size in zip((rows, columns), mask.shape, strict=True))
    height = WIDTH * (rows.stop - rows.start) / (columns.stop - columns.start)
    figure, (axis,) = panels(1, WIDTH, min(max(0.78 * height + 0.75, 1.5), 8.0))
    palette = colormaps[colours].with_extremes(bad="#d8d8d4")
    shown = np.where(mask, values, np.nan)[rows, columns]
    extent = (columns.start, columns.stop, rows.stop, rows.start)
    drawn = axis.imshow(shown, cmap=palette, vmin=limits[0], vmax=limits[1], extent=extent, interpolation="nearest")
    axis.set_title(PREDICTIONS[key], fontsize=9)
    axis.set_xlabel("x [px]", fontsize=8)
    axis.set_ylabel("y [px]", fontsize=8)
    bar = figure.colorbar(drawn, ax=axis, extend="max" if limits[0] == 0.0 else "both", shrink=0.9)
    bar.set_label(unit, fontsize=8)
    bar.ax.tick_params(labelsize=7)
    return image(_rasterised(figure), lossless=True)


def _rasterised(figure: Any) -> NDArray[np.uint8]:
    import cv2

    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=DPI)
    picture = cv2.imdecode(np.frombuffer(drawn.getvalue(), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return np.asarray(picture[..., ::-1], np.uint8)
