"""Plots of the gloss of a surface: β and γ of each pixel, the tail where it varies, and their standard errors."""

from __future__ import annotations

from typing import Any

import numpy as np

from hagoromo.files.plot import svg_text
from hagoromo.measurement.gloss.gloss_map import GlossMap

LOWEST_PERCENTILE, HIGHEST_PERCENTILE = 2.0, 98.0  # percentiles of the pixels at the ends of the colour scale


def gloss_plot(gloss: GlossMap, crop: tuple[slice, slice]) -> str:
    """SVG: β, γ and a tail that varies over the pixels of `crop` (rows, columns); the standard error of each below."""
    from matplotlib.figure import Figure

    rows, columns = crop
    tail = None if gloss.nu is None or gloss.nu_error is None else 1.0 / gloss.nu
    of_tail = None if tail is None or gloss.nu_error is None else np.where(tail > 0.0, gloss.nu_error, 0.0) * tail**2
    if tail is not None and not np.ptp(tail[np.isfinite(tail)]) > 0.0:
        tail = None
    height, width = (part.stop - part.start for part in crop)
    across = 4.2
    count = 2 if tail is None else 3
    figure = Figure(figsize=(count * across, 2 * max(0.82 * across * height / width, 1.5)), layout="constrained")
    extent = (columns.start, columns.stop, rows.stop, rows.start)
    panels: list[tuple[str, Any, str]] = [
        ("β [1/sr]", gloss.beta, "viridis"),
        ("γ [rad]", gloss.gamma, "viridis"),
        *([] if tail is None else [("1/ν of the tails", tail, "viridis")]),
        ("standard error of β, relative", gloss.beta_error / gloss.beta, "magma"),
        ("standard error of γ, relative", gloss.gamma_error / gloss.gamma, "magma"),
        *([] if tail is None else [("standard error of 1/ν", of_tail, "magma")]),
    ]
    for axes, (title, values, colours) in zip(figure.subplots(2, count).ravel(), panels, strict=True):
        shown = values[crop]
        known = shown[np.isfinite(shown)]
        low, high = np.percentile(known, (LOWEST_PERCENTILE, HIGHEST_PERCENTILE)) if known.size else (0.0, 1.0)
        drawn = axes.imshow(shown, cmap=colours, vmin=low, vmax=max(high, low + 1e-9), extent=extent)
        axes.set_title(title, fontsize=9)
        axes.set_xlabel("column [px]", fontsize=8)
        axes.set_ylabel("row [px]", fontsize=8)
        axes.tick_params(labelsize=7)
        figure.colorbar(drawn, ax=axes, shrink=0.8).ax.tick_params(labelsize=7)
    return svg_text(figure)
