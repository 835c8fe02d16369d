"""Plot of the residuals of a camera calibration: over the image, their distribution, and per photograph."""

from __future__ import annotations

import io

import numpy as np

from hagoromo.calibration.camera.calibrate_camera import CameraCalibration
from hagoromo.files.names import plot_label

OUTLIER_COLOUR, POINT_COLOUR = "#b5341d", "#2f5d9b"
ARROW_SHARE = 0.05  # of the image's width: how long the arrow of a residual of three rms is drawn


def residual_plot(calibration: CameraCalibration) -> bytes:
    """PNG: residual arrows over the image, residuals of x against y, rms per photograph with the outliers marked."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 4.4), layout="constrained", dpi=110)
    over_image, together, by_photograph = figure.subplots(1, 3)
    corners, residual = (np.concatenate(list(table.values())) for table in (calibration.corners, calibration.residuals))
    scale = ARROW_SHARE * calibration.camera.width / (3.0 * max(calibration.rms, 1e-9))
    arrows = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.002, "color": POINT_COLOUR}
    over_image.quiver(*corners.T, *(scale * residual).T, **arrows)
    over_image.set(xlim=(0, calibration.camera.width), ylim=(calibration.camera.height, 0), aspect="equal")
    over_image.set(xlabel="x [px]", ylabel="y [px]", title=f"measured − predicted, drawn × {scale:.0f}")
    together.plot(*residual.T, ".", markersize=3, color=POINT_COLOUR)
    reach = 1.1 * max(np.abs(residual).max(), 1e-9)
    together.set(xlim=(-reach, reach), ylim=(reach, -reach), aspect="equal")
    together.set(xlabel="residual in x [px]", ylabel="residual in y [px]", title=f"{len(corners)} corners")
    names = list(calibration.boards)
    colours = [OUTLIER_COLOUR if name in calibration.outliers else POINT_COLOUR for name in names]
    by_photograph.barh([plot_label(name) for name in names], list(calibration.boards.values()), color=colours)
    by_photograph.axvline(calibration.rms, color="#555", linewidth=0.8)
    by_photograph.invert_yaxis()
    by_photograph.tick_params(labelsize=7)
    by_photograph.set(xlabel="rms [px]", ylabel="photograph", title=f"rms {calibration.rms:.3f} px (outliers in red)")
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return picture.getvalue()
