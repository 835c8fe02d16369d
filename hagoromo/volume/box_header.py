"""Box header: all of a volume box but its voxels."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Literal, get_args

import numpy as np

from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.texel import Texel

Extinction = Literal["isotropic", "projected"]
EXTINCTIONS: tuple[Extinction, ...] = get_args(Extinction)


@dataclass(frozen=True, eq=False)
class BoxHeader:
    """What a volume box has besides its bricks; see `VolumeBox`, which checks it."""

    voxel_size: float
    tau: float
    materials: tuple[Reflectance, ...]
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))
    basis: tuple[Spectrum, ...] = ()
    name: str = ""
    provenance: dict[str, Any] = field(default_factory=dict)
    texel: Texel | None = None
    band: tuple[float, float] = (0.0, 1.0)
    shadow_bias: float = 0.0
    extinction: Extinction = "isotropic"
