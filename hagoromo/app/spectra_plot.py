"""Plot of the reflectance spectra of body colours, with their 95 % bands."""

from __future__ import annotations

from collections.abc import Mapping

from hagoromo.files.names import plot_label
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate
from hagoromo_figures.demo.plots import svg_text


def spectra_plot(spectra: Mapping[str, SpectrumEstimate]) -> str:
    """SVG: a curve with its band for each material by name."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.0, 3.6), layout="constrained")
    axes = figure.subplots()
    for number, (name, spectrum) in enumerate(spectra.items()):
        colour = f"C{number % 10}"
        axes.fill_between(spectrum.wavelengths, *spectrum.band_95, color=colour, alpha=0.2, linewidth=0)
        axes.plot(spectrum.wavelengths, spectrum.values, color=colour, label=plot_label(name) or None)
    axes.set_xlabel("wavelength [nm]")
    axes.set_ylabel("reflectance, mean 1")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize=8)
    return svg_text(figure)
