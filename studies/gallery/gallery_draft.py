"""Gallery draft: the drawdown of a woven cloth, as large as the cloth in the picture of 1 cm beside it."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.record import decode_one
from hagoromo_matter.recipes.cloth import WEAVES

PIXELS_PER_CROSSING = 16  # before the drawing is brought to its size
WARP_UP, WEFT_UP, LINE = 30, 245, 150  # grey levels


def drawn(record: Mapping[str, Any], field_mm: float, size: int) -> NDArray[np.uint8] | None:
    """(size, size, 3) the draft of a recipe over `field_mm`: dark where the warp is on the face; None: not woven.

    The first pick is at the bottom, as in the picture. Ends and picks are as many as the cloth has, but begin where
    the repeat begins.
    """
    import cv2

    if record["kind"] != "cloth":
        return None
    down = decode_one(record["draft"], WEAVES, "[draft]").draft().drawdown
    per_mm = np.array([record["weft_per_cm"], record["warp_per_cm"]]) / 10.0
    many = np.ceil(per_mm * field_mm).astype(int)
    repeats = -(-many // down.shape)
    grid = np.where(np.tile(down, repeats)[: many[0], : many[1]][::-1], WARP_UP, WEFT_UP).astype(np.uint8)
    large = np.kron(grid, np.ones((PIXELS_PER_CROSSING, PIXELS_PER_CROSSING), np.uint8))
    large[::PIXELS_PER_CROSSING] = LINE
    large[:, ::PIXELS_PER_CROSSING] = LINE
    high, wide = np.round(per_mm * field_mm * PIXELS_PER_CROSSING).astype(int)
    small = cv2.resize(large[-high:, :wide], (size, size), interpolation=cv2.INTER_AREA).astype(np.uint8)
    return np.repeat(small[..., None], 3, axis=2)
