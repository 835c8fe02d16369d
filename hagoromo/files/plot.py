"""Plots drawn by matplotlib without a window, and as SVG text that is the same each time."""

from __future__ import annotations

import io
import re
from typing import Any


def panels(count: int, width: float, height: float) -> Any:
    """A figure, independent of pyplot's global state, with `count` axes of the given size [inch] side by side."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    axes = figure.subplots(1, count, squeeze=False)[0]
    for axis in axes:
        axis.tick_params(labelsize=8)
        axis.spines[["top", "right"]].set_visible(False)
    return figure, axes


def svg_text(figure: Any) -> str:
    """The figure as an <svg> element; the text is reproducible."""
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "hagoromo", "svg.fonttype": "none"}):
        text = io.StringIO()
        figure.savefig(text, format="svg", metadata={"Date": None})
    svg = text.getvalue()
    return re.sub(r"<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
