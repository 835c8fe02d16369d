"""A BRDF as a CSV table: a row for each pair of directions, with the value of each channel.

Directions are columns theta_lamp_deg, phi_lamp_deg, theta_eye_deg, phi_eye_deg (θ from the sample's normal, φ about
it), or to_lamp_x … to_eye_z. All other columns are channels [1/sr], but variance_NAME [1/sr²] of a channel NAME.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError, described
from hagoromo.files.format import start_of
from hagoromo.files.table import read_table
from hagoromo.measurement.reflectance_table import ReflectanceTable

ANGLES = ("theta_lamp_deg", "phi_lamp_deg", "theta_eye_deg", "phi_eye_deg")
VECTORS = tuple(f"{way}_{axis}" for way in ("to_lamp", "to_eye") for axis in "xyz")
VARIANCE = "variance_"


def is_reflectance_csv(path: Path) -> bool:
    """Whether a .csv names its directions so."""
    if path.is_dir() or path.suffix.lower() != ".csv":
        return False
    start = start_of(path).decode("utf-8-sig", "replace")
    head = next((line for line in start.splitlines() if line.strip() and not line.startswith("#")), "")
    named = {name.strip() for name in head.split(",")}
    return named >= set(ANGLES) or named >= set(VECTORS)


def read_reflectance_csv(path: str | Path) -> ReflectanceTable:
    """The table in a file; `InputError` without its directions, without a channel, or with some variances only."""
    columns = read_table(path)
    with described(str(path)):
        if set(ANGLES) <= set(columns):
            lamp, eye = (_unit(columns, way) for way in ("lamp", "eye"))
        elif set(VECTORS) <= set(columns):
            lamp, eye = (np.stack([columns[f"{way}_{axis}"] for axis in "xyz"], 1) for way in ("to_lamp", "to_eye"))
        else:
            raise InputError(
                f"its directions are missing: give the columns {', '.join(ANGLES)}, or {', '.join(VECTORS)}"
            )
        rest = [name for name in columns if name not in (*ANGLES, *VECTORS)]
        channels = [name for name in rest if not name.startswith(VARIANCE)]
        stated = [name for name in channels if VARIANCE + name in rest]
        if not channels or len(rest) != len(channels) + len(stated) or (stated and stated != channels):
            raise InputError(
                f"it has the channels {', '.join(channels) or 'none'} and variances of {', '.join(stated) or 'none'}: "
                "give a column for each channel, and variance_NAME for all of them or none"
            )
        values = np.stack([columns[name] for name in channels], 1)
        variance = np.stack([columns[VARIANCE + name] for name in channels], 1) if stated else None
        return ReflectanceTable(lamp, eye, values, variance, tuple(channels))


def _unit(columns: Mapping[str, NDArray[np.float64]], way: str) -> NDArray[np.float64]:
    polar, turn = (np.radians(columns[f"{angle}_{way}_deg"]) for angle in ("theta", "phi"))
    return np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], 1)
