"""Plot of reflectance spectra with their 95 % bands, a panel each, all on one scale, with the colour under D65."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from typing import Any

from hagoromo.files.names import plot_label
from hagoromo.image.spectra.spectrum_colour import xyz
from hagoromo.light.colour import srgb_encode, srgb_from_xyz
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate

COLUMNS_OF_PLOTS, MOST_PLOTS = 3, 24
BAND, LINE, TRUTH = "#9fb4cc", "#1a1a1a", "#c00000"


def spectra_plot(
    estimates: Mapping[str, SpectrumEstimate], form: str = "png", truth: Mapping[str, Sequence[float]] | None = None
) -> bytes:
    """Picture ("png" or "svg") of the first spectra with their 95 % bands, a panel each, in one scale.

    Panels have the spectrum's colour under D65.
    """
    picture = io.BytesIO()
    metadata = {"Software": None} if form == "png" else {"Date": None}
    spectra_figure(estimates, truth).savefig(picture, format=form, metadata=metadata)
    return picture.getvalue()


def spectra_figure(
    estimates: Mapping[str, SpectrumEstimate],
    truth: Mapping[str, Sequence[float]] | None = None,
    quantity: str = "reflectance",
) -> Any:
    """The plot as a figure of matplotlib. truth: name → spectrum, drawn dashed. quantity: label of the values."""
    from matplotlib.figure import Figure

    shown = dict(list(estimates.items())[:MOST_PLOTS])
    columns = min(COLUMNS_OF_PLOTS, len(shown))
    rows = -(-len(shown) // columns)
    figure = Figure(figsize=(max(3.4 * columns, 4.4), 2.6 * rows + 0.3), layout="constrained", dpi=120)
    axes = figure.subplots(rows, columns, squeeze=False, sharex=True, sharey=True)
    for axis, (name, estimate) in zip(axes.flat, shown.items(), strict=False):
        _panel(axis, name, estimate, truth.get(name) if truth else None)
    for axis in list(axes.flat)[len(shown) :]:
        axis.set_axis_off()
    first = axes.flat[0]
    first.set_xlim(*(next(iter(shown.values())).wavelengths[k] for k in (0, -1)))
    first.set_ylim(0.0, max(1.05 * float(max(of.band_95[1].max() for of in shown.values())), 0.05))
    figure.legend(*first.get_legend_handles_labels(), loc="outside upper right", ncols=3, fontsize=8, frameon=False)
    figure.supxlabel("wavelength [nm]", fontsize=9)
    figure.supylabel(quantity, fontsize=9)
    return figure


def _panel(axis: Any, name: str, estimate: SpectrumEstimate, truth: Sequence[float] | None) -> None:
    low, high = estimate.band_95
    axis.set_axisbelow(True)
    axis.grid(color="#e3e3e3", linewidth=0.6)
    axis.fill_between(estimate.wavelengths, low, high, color=BAND, linewidth=0, label="95 % band")
    axis.plot(estimate.wavelengths, estimate.values, color=LINE, linewidth=1.2, label="estimate")
    if truth is not None:
        axis.plot(estimate.wavelengths, truth, color=TRUTH, linewidth=0.9, linestyle="--", label="truth")
    swatch = {"marker": "s", "markersize": 12, "markerfacecolor": _tint(estimate), "markeredgecolor": "#808080"}
    axis.plot([0.06], [0.9], transform=axis.transAxes, linestyle="none", **swatch)
    axis.set_title(plot_label(name), fontsize=9)
    axis.tick_params(labelsize=8)
    if not estimate.explained:
        axis.text(0.5, 0.5, "not explained", color=TRUTH, ha="center", transform=axis.transAxes)


def _tint(estimate: SpectrumEstimate) -> tuple[float, float, float]:
    """Colour of the spectrum under D65, as a display shows it."""
    colour = srgb_encode(srgb_from_xyz(xyz(estimate.values, Spectrum.named("D65")))) / 255.0
    return tuple(float(value) for value in colour)  # type: ignore[return-value]
