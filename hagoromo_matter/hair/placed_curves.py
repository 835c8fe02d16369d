"""Placed curves: polylines of a file, turned and made as large as they are to be. In mm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from hagoromo.errors import InputError
from hagoromo_formats.curves.curve_file import read_curves
from hagoromo_matter.hair.fibres import Curves


def placed(path: Path, place: Any, diameter_mm: float | None, usual_mm: float) -> Curves:
    """The curves of a file; place: `CurvesTable`. diameter_mm: of all fibres; None: the file's, or `usual_mm`."""
    lines = read_curves(path)
    turn = Rotation.from_euler("xyz", place.rotation_deg, degrees=True).as_matrix()
    points = lines.points @ turn.T
    unit = 1.0 if place.unit_mm is None else place.unit_mm
    if place.height_mm is not None:
        height = float(np.ptp(points[:, 2]))
        if not height > 0:
            raise InputError(f"{path}: its curves lie flat after rotation_deg: give unit_mm in the place of height_mm")
        unit = place.height_mm / height
    points = points * unit
    if diameter_mm is not None or lines.diameter is None:
        diameter = np.full(len(points), usual_mm if diameter_mm is None else diameter_mm)
    else:
        diameter = lines.diameter * unit
    if not (np.isfinite(points).all() and np.isfinite(diameter).all() and diameter.min() >= 0 < diameter.max()):
        raise InputError(f"{path}: its curves are not finite, or have no thickness, at {unit:g} mm a unit: check both")
    return Curves(points, lines.first, diameter)
