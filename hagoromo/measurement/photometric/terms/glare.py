"""Veiling glare: light that lens and housing scatter over the whole picture, the same share of its mean everywhere.

    recorded = reading + g · mean of the photograph over its frame, per channel

g is the veiling glare index of ISO 9358: the light in the picture of a black patch over that of its white surroundings.
"""

from __future__ import annotations

import numpy as np

from hagoromo.measurement.photometric.term import ReadingChange, Term
from hagoromo.photograph.photograph import Photograph


def change(photograph: Photograph) -> ReadingChange:
    """The mean (C,) of all recorded values of the frame, also beside the object, that are finite."""
    known = np.isfinite(photograph.values)
    total = np.sum(photograph.values, axis=(0, 1), where=known, dtype=np.float64)
    return ReadingChange(added=total / np.maximum(known.sum(axis=(0, 1)), 1))


GLARE = Term(
    name="glare",
    words="veiling glare of the lens",
    unit="of the mean of each photograph",
    mean=0.0,
    spread=0.03,
    range=(0.0, 0.3),
    source="veiling glare indices by ISO 9358 of camera lenses: 0.5 to 4 %",
    change=change,
)
