"""Plots of the demo's report, drawn by matplotlib without a window, as SVG text."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.plot import panels, svg_text
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.parameters import ROWS, STATED
from hagoromo_matter.demo.measurement import ParameterRow
from hagoromo_page.report.report_pictures import MATERIAL_COLOURS

SYMBOLS = {key: ROWS[key].shown for key in STATED}
PLOT_WAVELENGTHS = np.linspace(400.0, 700.0, 301)  # [nm]


def measured_against_true(rows: Sequence[ParameterRow]) -> str:
    """One panel per parameter: (estimate − true)/true [%] with the 95 % interval, per material."""
    figure, axes = panels(len(SYMBOLS), 10.0, 2.7)
    for axis, (key, label) in zip(axes, SYMBOLS.items(), strict=True):
        shown = [row for row in rows if row.parameter == key]
        for place, row in enumerate(shown):
            low, middle, high = (100.0 * (value / row.true - 1.0) for value in (row.low, row.estimate, row.high))
            style = {
                "color": MATERIAL_COLOURS.get(row.material, "black"),
                "capsize": 4,
                "marker": "o",
                "markersize": 4.5,
            }
            fill = {} if row.identifiable else {"markerfacecolor": "white"}
            axis.errorbar(place, middle, [[max(middle - low, 0.0)], [max(high - middle, 0.0)]], **style, **fill)
            below = {"xycoords": ("data", "axes fraction"), "ha": "center", "fontsize": 7.5, "color": "#555"}
            axis.annotate(f"{row.true:.3g}", (place, 0.02), **below)
        axis.axhline(0.0, color="#999", linewidth=0.8, zorder=0)
        axis.set_xticks(range(len(shown)), [row.material for row in shown], fontsize=8, rotation=20)
        axis.set_xlim(-0.6, len(shown) - 0.4)
        axis.margins(y=0.25)
        axis.set_title(label, fontsize=10)
    axes[0].set_ylabel("estimate − true [% of true]", fontsize=9)
    return svg_text(figure)


def spectra(true: Mapping[str, Spectrum], recovered: Mapping[str, Spectrum]) -> str:
    """Albedo spectra π α c_b(λ): true (line) and recovered from three channels (dashed)."""
    figure, (axis,) = panels(1, 6.4, 3.4)
    for name, spectrum in true.items():
        axis.plot(PLOT_WAVELENGTHS, spectrum.at(PLOT_WAVELENGTHS), color=MATERIAL_COLOURS.get(name), label=name)
        axis.plot(
            PLOT_WAVELENGTHS, recovered[name].at(PLOT_WAVELENGTHS), color=MATERIAL_COLOURS.get(name), linestyle="--"
        )
    axis.set_xlim(400.0, 700.0)
    axis.set_ylim(bottom=0.0)
    axis.set_xlabel("wavelength [nm]", fontsize=9)
    axis.set_ylabel("body albedo π α c_b", fontsize=9)
    axis.plot([], [], color="#777", label="true")
    axis.plot([], [], color="#777", linestyle="--", label="recovered")
    axis.legend(fontsize=8, frameon=False, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return svg_text(figure)


def residual_histogram(residuals: NDArray) -> str:
    """Histogram of standardised residuals beside the standard normal law, on a logarithmic axis."""
    figure, (axis,) = panels(1, 5.2, 3.4)
    edges = np.linspace(-6.0, 6.0, 97)
    density = np.histogram(np.clip(residuals, -6.0, 6.0), edges)[0] / residuals.size / np.diff(edges)
    axis.stairs(density, edges, fill=True, color="#9db7d5", label=f"{residuals.size:,} values".replace(",", " "))
    deviation = np.linspace(-6.0, 6.0, 401)
    axis.plot(
        deviation, np.exp(-0.5 * deviation**2) / np.sqrt(2.0 * np.pi), color="#222", linewidth=1.2, label="normal law"
    )
    axis.set_yscale("log")
    axis.set_ylim(1e-6, 1.0)
    axis.set_xlim(-6.0, 6.0)
    axis.set_xlabel("residual [stated standard deviations]", fontsize=9)
    axis.set_ylabel("density", fontsize=9)
    axis.legend(fontsize=8, frameon=False, loc="upper right")
    return svg_text(figure)
