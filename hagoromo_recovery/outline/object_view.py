"""Object view: a photograph and where the object is in it."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.surface.tile_store import binned, means
from hagoromo.photograph.photograph import Photograph

LEAST_VALID = 0.75  # share of the pixels that are joined to one, that must be valid


@dataclass(frozen=True, eq=False)
class ObjectView:
    """A photograph; `share` (h, w): of each pixel that the object covers, 0…1. stated: whether a mask states it."""

    photograph: Photograph
    share: NDArray
    stated: bool = True

    @property
    def silhouette(self) -> NDArray[np.bool_]:
        """(h, w), where the object is."""
        return self.share >= 0.5

    def reduced(self, factor: int) -> ObjectView:
        """With pixels that are means of factor × factor valid ones."""
        if factor == 1:
            return self
        small = binned(self.photograph, factor, LEAST_VALID)
        return ObjectView(small, means(self.share, factor)[..., 0], self.stated)
