"""Curves over the wavelength as a picture, for notebooks."""

from __future__ import annotations

import io
from collections.abc import Mapping

from numpy.typing import NDArray

from hagoromo.files.names import plot_label

COLOURS = {"R": "#b00020", "G": "#2e7d32", "B": "#1f4e8c"}


def curves_png(wavelengths: NDArray, curves: Mapping[str, NDArray], label: str) -> bytes:
    """PNG of curves over `wavelengths` [nm], each by its name (none: no legend). label: of the vertical axis."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(5.0, 2.6), layout="constrained", dpi=100)
    axes = figure.subplots()
    for name, values in curves.items():
        axes.plot(
            wavelengths, values, color=COLOURS.get(name, None if name else "#333"), label=plot_label(name) or None
        )
    axes.set_xlabel("wavelength [nm]")
    axes.set_ylabel(label)
    axes.set_ylim(bottom=min(0.0, *(float(values.min()) for values in curves.values())))
    if any(curves):
        axes.legend(frameon=False, fontsize=8)
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return picture.getvalue()
