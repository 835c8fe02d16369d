"""Plots drawn by matplotlib without a window, and as SVG text that is the same each time."""

from __future__ import annotations

import io
import math
import re
from collections.abc import Mapping
from typing import Any

from numpy.typing import NDArray

from hagoromo.files.names import plot_label

CHANNEL_COLOURS = {"R": "#b00020", "G": "#2e7d32", "B": "#1f4e8c"}


def panels(count: int, width: float, height: float) -> Any:
    """A figure, independent of pyplot's global state, with `count` axes of the given size [inch] side by side."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(1, count, squeeze=False)[0]
    for axis in axes:
        axis.tick_params(labelsize=8)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def nice(value: float) -> float:
    """1, 2 or 5 times a power of ten, at least `value`."""
    power = 10.0 ** math.floor(math.log10(max(value, 1e-6)))
    return next(step * power for step in (1.0, 2.0, 5.0, 10.0) if step * power >= value)


def svg_text(figure: Any) -> str:
    """The figure as an <svg> element; the text is reproducible."""
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "hagoromo", "svg.fonttype": "none"}):
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)


def curves_png(wavelengths: NDArray, curves: Mapping[str, NDArray], label: str) -> bytes:
    """PNG of curves over `wavelengths` [nm], each by its name (none: no legend). label: of the vertical axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 2.6), layout="constrained", dpi=100)
    axes = figure.subplots()
    for name, values in curves.items():
        axes.plot(
            wavelengths,
            values,
            color=CHANNEL_COLOURS.get(name, None if name else "#333"),
            label=plot_label(name) or None,
        )
    axes.set_xlabel("wavelength [nm]")
    axes.set_ylabel(label)
    axes.set_ylim(bottom=min(0.0, *(float(values.min()) for values in curves.values())))
    if any(curves):
        axes.legend(frameon=False, fontsize=8)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return picture.getvalue()
