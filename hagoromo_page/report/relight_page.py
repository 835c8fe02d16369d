"""The page of a relit object: photographs, predictions, maps of differences and ΔE00 with scales, and a table."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.plot import nice
from hagoromo.image.relight.prediction import PREDICTIONS, RELIEF_RIM_PX, Prediction
from hagoromo.image.relight.relighting import Relighting
from hagoromo.light.colour import delta_e_2000, srgb_encode
from hagoromo_page.report.measure_report import report_viewer
from hagoromo_page.report.page import page_picture, page_viewer, write_page
from hagoromo_page.report.report_pictures import around, map_picture

SCALE_PERCENTILE = 95  # percentile of a map that its scale holds
PHOTOGRAPH_WIDTH_PX = 320  # px, of a small photograph on the page


def write_relight_report(path: Path, relighting: Relighting) -> None:
    """Write the page to `path`: one self-contained HTML file."""
    capture = relighting.measurement.capture
    assert capture is not None  # `relight` measured it
    write_page(
        path,
        "relight.html.j2",
        name=capture.own_name,
        measured=len(capture.photographs),
        rim=RELIEF_RIM_PX,
        linearity=relighting.measurement.linearity,
        health=relighting.measurement.health,
        found=[
            *(_found(one) for one in relighting.predictions),
            *([f"{relighting.advice}."] if relighting.advice else []),
        ],
        rows=[row for one in relighting.predictions for row in _rows(one)],
        photographs=[_photograph(one) for one in relighting.predictions],
        **page_viewer(report_viewer(relighting.measurement)),
    )


def _found(one: Prediction) -> str:
    """How near the prediction comes, in a sentence."""
    boxes = one.compared[one.of_boxes]
    said = f"{one.name}: the volume boxes differ from the photograph by {100 * boxes.relative_rmse:.1f} % of its"
    said += f" brightness (root mean square), a colour difference of {boxes.delta_e_2000:.1f} ΔE00 in the mean"
    said += ", with shadows and misfit learnt" if one.of_boxes == "boxes_learnt" else ""
    said += f"; {one.forecast}" if one.forecast else ""
    lambert = one.compared.get("lambert")
    if lambert is None:
        return f"{said}."
    return f"{said}. Lambert's law, fitted to each pixel, is off by {100 * lambert.relative_rmse:.1f} %."


def _rows(one: Prediction) -> list[list[str]]:
    rows = []
    for key, compared in one.compared.items():
        worst = np.percentile(_delta_e(one, key)[one.mask], 95)
        psnr = "∞" if compared.psnr is None else f"{compared.psnr:.1f}"
        figures = [f"{100 * compared.relative_rmse:.1f} %", f"{compared.delta_e_2000:.2f}", f"{worst:.2f}", psnr]
        rows.append([one.name, PREDICTIONS[key], *figures, f"{compared.ssim:.3f}", str(compared.pixels)])
    return rows


def _photograph(one: Prediction) -> dict[str, Any]:
    crop = around(one.mask)
    shown = [
        page_picture(_enlarged(one.photograph[crop]), f"photograph {one.name}", "photograph, held out", lossless=True)
    ]
    shown += [
        page_picture(
            _enlarged(view[crop]), f"prediction of {one.name}: {PREDICTIONS[key]}", PREDICTIONS[key], lossless=True
        )
        for key, view in one.predictions.items()
    ]
    differences = {key: (view - one.photograph).mean(axis=2) for key, view in one.predictions.items()}
    limit = nice(max(np.percentile(np.abs(d[one.mask]), SCALE_PERCENTILE) for d in differences.values()))
    colours = {key: _delta_e(one, key) for key in one.predictions}
    reach = nice(max(np.percentile(d[one.mask], SCALE_PERCENTILE) for d in colours.values()))
    return {
        "name": one.name,
        "lamps": "; ".join(one.lamps),
        "pictures": shown,
        "differences": [
            map_picture(
                100.0 * difference,
                one.mask,
                crop,
                "RdBu_r",
                (-100 * limit, 100 * limit),
                "% of white",
                PREDICTIONS[key],
            )
            for key, difference in differences.items()
        ],
        "colours": [
            map_picture(colour, one.mask, crop, "magma", (0.0, reach), "ΔE00", PREDICTIONS[key])
            for key, colour in colours.items()
        ],
    }


def _enlarged(linear: NDArray[np.float64]) -> NDArray[np.uint8]:
    """sRGB picture, enlarged by a whole number to about PHOTOGRAPH_WIDTH_PX pixels of width."""
    times = max(round(PHOTOGRAPH_WIDTH_PX / linear.shape[1]), 1)
    return srgb_encode(linear).repeat(times, axis=0).repeat(times, axis=1)


def _delta_e(one: Prediction, key: str) -> NDArray[np.float64]:
    a, b = (np.clip(values, 0.0, None) for values in (one.predictions[key], one.photograph))
    return np.where(one.mask, delta_e_2000(a, b), 0.0)
