"""Plot of the curves of a calibrated response with their 95 % intervals."""

from __future__ import annotations

import io

from hagoromo.calibration.response.response_calibration import ResponseCalibration
from hagoromo.files.names import plot_label
from hagoromo.files.plot import panels

CHANNEL_COLOURS = {"R": "#b00020", "G": "#2e7d32", "B": "#1f4e8c"}


def response_plot(calibration: ResponseCalibration) -> bytes:
    """PNG of the curves, relative to the greatest value."""
    figure, (axis,) = panels(1, 6.4, 3.6)
    response = calibration.response
    top = response.values.max()
    for channel, name in enumerate(response.channels):
        colour = CHANNEL_COLOURS.get(name, f"C{channel}")
        low, high = calibration.interval_95[:, channel].T / top
        axis.fill_between(response.wavelengths, low, high, color=colour, alpha=0.25, linewidth=0)
        axis.plot(response.wavelengths, response.values[:, channel] / top, color=colour, label=plot_label(name))
    axis.set_xlabel("wavelength [nm]", fontsize=9)
    axis.set_ylabel("response [of the greatest], 95 % interval", fontsize=9)
    axis.set_ylim(0.0, 1.3)
    axis.legend(fontsize=8, frameon=False)
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=120, metadata={"Software": None})
    return data.getvalue()
