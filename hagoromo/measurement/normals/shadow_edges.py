"""Edges of cast shadows: pixels of which a lamp may light a part only, known by a dark pixel beside them.

The model knows pixels that a lamp lights, and others. Where a shadow ends within a pixel, its value is a share of what
the whole pixel would send back, and that share is unknown. Where many lamps light a pixel, such a value is an outlier
that others correct. Where three or four do, as in a hollow, normal and body follow it: lines at the edges of shadows.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter, minimum_filter

Array = NDArray[np.float64]

DARK = 0.25  # of the brightest neighbour: a darker pixel beside it is in shadow
HIGHLIGHT = 1.5  # times what lamps make of a pixel in the median: brighter neighbours have a highlight
LEAST = 0.1  # of what lamps make of a pixel in the median, that an edge lacks; where matter curves it is less
SIZE = 3  # pixels of a side of the square of neighbours


def lacking(
    values: Array, used: NDArray[np.bool_], valid: NDArray[np.bool_], pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> Array:
    """(K, P) what values at the edge of a cast shadow may lack; else 0.

    That is how far they are below their brightest neighbour, less what the light goes on to rise by beyond it: where a
    surface turns away from a lamp light falls evenly, and nothing is lacking.

    values: (K, P), means of the channels over irradiance. used, valid: (K, P) above the noise, and valid; rows and
    columns of the pixels (P,). Neighbours are compared by their value over that under all lamps, in the median, so that
    paint makes no edge.
    """
    usual = np.ones(values.shape[1])
    lit = used.any(axis=0)
    usual[lit] = np.nanmedian(np.where(used, values, np.nan)[:, lit], axis=0)
    rows, columns = (one - one.min() for one in pixels)
    shape, found = (rows.max() + 1, columns.max() + 1), np.zeros(values.shape)
    for share, known, lacks in zip(values / usual, valid, found, strict=True):
        image = np.full(shape, np.nan)
        image[rows[known], columns[known]] = share[known]
        outside = np.isnan(image)
        least = minimum_filter(np.where(outside, np.inf, image), SIZE, mode="nearest")[rows, columns]
        image = np.where(outside, -np.inf, np.minimum(image, HIGHLIGHT))
        most, farther = (maximum_filter(image, size, mode="nearest")[rows, columns] for size in (SIZE, 2 * SIZE - 1))
        with np.errstate(invalid="ignore"):  # around pixels that are not valid
            step = 2.0 * most - share - farther
        lacks[:] = np.where(known & (least < DARK * most) & (step > LEAST), step, 0.0)
    return found * usual
