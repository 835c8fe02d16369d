"""The page of a change: both dates side by side, maps of what changed, the rest in grey, with errors, and tables."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.plot import nice, panels, svg_text
from hagoromo.light.colour import srgb_encode
from hagoromo_campaigns.change import WORDS, Change, CommonChange
from hagoromo_campaigns.change_files import section_figure
from hagoromo_campaigns.quantity import Quantity
from hagoromo_campaigns.region import ChangedRegion
from hagoromo_page.report.display import exposure
from hagoromo_page.report.page import page_drawing, page_picture, thousands, write_page
from hagoromo_page.report.report_pictures import around, rasterised

MAP_WIDTH_INCH = 4.6  # inch, of a map
PICTURE_WIDTH_PX = 420  # px, about, of the pictures of both dates
SCALE_PERCENTILE = 98  # percentile of a map that its scale holds
MOST_ROWS = 30  # of a table of regions on the page; regions.csv has all
GREY, BESIDE = "#c9c9c5", "#ffffff"  # of what is not significant, and of what is not compared
HEAD = ("region", "area", "middle x, y [px]", "mean", "95 % interval", "most")
ABOUT = {
    "colour": "Colour difference ΔE00 of the body colours, without highlights (an eye can just distinguish about 1).",
    "gloss": "Change of the strength of the highlight, β F₀.",
    "width": "Change of the width of the highlight, γ: a rougher surface has a wider one.",
    "shape": "Change of the surface along its normal: below 0 matter is gone, above 0 it was added.",
    "normals": "Angle between the normals of both dates.",
}


def write_change_report(path: Path, change: Change) -> None:
    """Write the page to `path`: one self-contained HTML file."""
    crop = around(change.compared)
    write_page(
        path,
        "change.html.j2",
        before=change.before.name,
        after=change.after.name,
        found=_found(change),
        remarks=change.remarks,
        doubted=any(remark.startswith("doubted") for remark in change.remarks),
        pictures=_pictures(change, crop),
        section=_section(change),
        quantities=[_quantity(change, one, crop) for one in change.quantities],
        errors=[_errors(one) for one in change.quantities],
        common=[_common(one) for one in change.common],
        rate=f"{100 * change.rate:g} %",
        share=f"{100 * change.rate / len(change.quantities):.2g} %",
        maps=len(change.quantities),
        assumptions=change.assumptions,
    )


def _section(change: Change) -> dict[str, Any] | None:
    if change.section is None:
        return None
    sentence = change.section.sentence
    picture = page_drawing(svg_text(section_figure(change)), "heights of both dates along a line, and their difference")
    remarks = change.section.before.remarks
    return {"picture": picture, "said": [f"{sentence[0].upper()}{sentence[1:]}.", *remarks]}


def _found(change: Change) -> list[str]:
    sentence, registered = change.sentence, change.registration
    paint, relief = registered.agreement
    said = [
        f"{sentence[0].upper()}{sentence[1:]}.",
        f"{thousands(int(change.compared.sum()))} pixels are compared, those that both show.",
        f"Both surfaces were laid on one another to {registered.error_px:.2g} px; the detail of paint then agrees by "
        f"{paint:.3f} of 1, that of relief by {relief:.3f}.",
    ]
    if not registered.status.converged:
        said.append(f"{registered.status.remark('the registration')}.")
    return said


def _pictures(change: Change, crop: tuple[slice, slice]) -> list[Any]:
    scale = exposure(np.nan_to_num(change.pictures[0]), change.compared.astype(float))
    titles = (f"{change.before.name} (before)", f"{change.after.name} (after)")
    shown = []
    for linear, title in zip(change.pictures, titles, strict=True):
        picture = np.where(change.compared[..., None], srgb_encode(scale * np.nan_to_num(linear)), 255).astype(np.uint8)
        times = max(round(PICTURE_WIDTH_PX / picture[crop].shape[1]), 1)
        shown.append(page_picture(picture[crop].repeat(times, axis=0).repeat(times, axis=1), title, title, True))
    return shown


def _quantity(change: Change, one: Quantity, crop: tuple[slice, slice]) -> dict[str, Any]:
    own = [region for region in change.regions if region.quantity == one.name]
    maps = []
    for label, value in one.value.items():
        of_lamp = [region for region in own if region.lamp == label]
        under = f", {label}" if label else ""
        maps.append(_map(one, value, of_lamp, crop, f"{WORDS[one.name]}{under}: significant"))
        maps.append(_error_map(one, one.error[label], crop, f"standard error of a pixel{under}"))
    several = len(one.value) > 1
    return {
        "name": WORDS[one.name].capitalize(),
        "about": ABOUT[one.name],
        "maps": maps,
        "rows": [_row(region, several) for region in own[:MOST_ROWS]],
        "more": max(len(own) - MOST_ROWS, 0),
        "head": HEAD if not several else (HEAD[0], "lamp", *HEAD[1:]),
    }


def _row(region: ChangedRegion, several: bool) -> list[str]:
    unit = region.unit
    lamp = [region.lamp] if several else []
    return [
        f"{region.number}",
        *lamp,
        f"{region.area:.3g} {region.area_unit}",
        f"{region.x_px:.0f}, {region.y_px:.0f}",
        f"{region.mean:.3g} {unit}",
        f"{region.low:.3g} to {region.high:.3g}",
        f"{region.most:.3g}",
    ]


def _errors(one: Quantity) -> list[str]:
    error = next(iter(one.error.values()))[one.compared]
    widening = ", ".join(f"{wider:.2g}" for wider in one.significance.widening)
    share = float(one.significance.found.sum()) / max(int(one.compared.sum()), 1)
    return [WORDS[one.name], f"{np.median(error):.2g} {one.unit}", widening, f"{100 * share:.2g} %"]


def _common(one: CommonChange) -> list[str]:
    error = f"± {100 * one.error:.2g} %" if math.isfinite(one.error) else "not known"
    name = f"{WORDS[one.quantity]}{f', channel {one.channel}' if one.channel else ''}"
    return [name, f"{100 * one.change:+.2g} %", error, "yes" if one.significant else "no"]


def _map(
    one: Quantity, value: NDArray[np.float64], own: list[ChangedRegion], crop: tuple[slice, slice], title: str
) -> str:
    """An <img> of what is significant, over grey where it is not; regions have their numbers."""
    found = one.significance.found
    reach = nice(float(np.percentile(np.abs(value[found]), SCALE_PERCENTILE))) if found.any() else 1.0
    colours, limits = ("RdBu_r", (-reach, reach)) if one.signed else ("inferno_r", (0.0, reach))
    axis, figure = _axis(one, crop, title)
    _shown(figure, axis, np.where(found, value, np.nan), crop, colours, limits, one.unit)
    for region in own[:MOST_ROWS]:
        axis.annotate(f"{region.number}", (region.x_px, region.y_px), xytext=(12, 12), textcoords="offset points",
                      fontsize=8, arrowprops={"arrowstyle": "-", "lw": 0.6}, annotation_clip=True)  # fmt: skip
    return page_picture(rasterised(figure), f"map in {one.unit}: {title}", lossless=True)


def _error_map(one: Quantity, error: NDArray[np.float64], crop: tuple[slice, slice], title: str) -> str:
    reach = nice(float(np.percentile(error[one.compared], SCALE_PERCENTILE)))
    axis, figure = _axis(one, crop, title)
    _shown(figure, axis, np.where(one.compared, error, np.nan), crop, "viridis", (0.0, reach), one.unit)
    return page_picture(rasterised(figure), f"map in {one.unit}: {title}", lossless=True)


def _axis(one: Quantity, crop: tuple[slice, slice], title: str) -> tuple[Any, Any]:
    """An axis that shows what is compared in grey, and its figure."""
    from matplotlib.colors import ListedColormap

    rows, columns = _within(crop, one.compared.shape)
    height = MAP_WIDTH_INCH * (rows.stop - rows.start) / (columns.stop - columns.start)
    figure, (axis,) = panels(1, MAP_WIDTH_INCH, min(max(0.78 * height + 0.75, 1.5), 8.0))
    beneath = one.compared[rows, columns].astype(float)
    axis.imshow(beneath, cmap=ListedColormap([BESIDE, GREY]), vmin=0.0, vmax=1.0, extent=_extent(rows, columns),
                interpolation="nearest")  # fmt: skip
    axis.set_title(title, fontsize=9)
    axis.set_xlabel("x [px]", fontsize=8)
    axis.set_ylabel("y [px]", fontsize=8)
    return axis, figure


def _shown(
    figure: Any,
    axis: Any,
    values: NDArray[np.float64],
    crop: tuple[slice, slice],
    colours: str,
    limits: tuple[float, float],
    unit: str,
) -> None:
    """Draw `values`, NaN: nothing, with a bar of their colours."""
    rows, columns = _within(crop, values.shape)
    drawn = axis.imshow(values[rows, columns], cmap=colours, vmin=limits[0], vmax=limits[1],
                        extent=_extent(rows, columns), interpolation="nearest")  # fmt: skip
    bar = figure.colorbar(drawn, ax=axis, extend="max" if limits[0] == 0.0 else "both", shrink=0.9)
    bar.set_label(unit, fontsize=8)
    bar.ax.tick_params(labelsize=7)


def _within(crop: tuple[slice, slice], shape: tuple[int, ...]) -> tuple[slice, slice]:
    rows, columns = (slice(one.start, min(one.stop, size)) for one, size in zip(crop, shape, strict=True))
    return rows, columns


def _extent(rows: slice, columns: slice) -> tuple[int, int, int, int]:
    return columns.start, columns.stop, rows.stop, rows.start
