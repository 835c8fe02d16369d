"""Matter shape: an object on a lattice as plain arrays, by either law of matter."""

from __future__ import annotations

from typing import TypeAlias

from hagoromo_recovery.choices import Law
from hagoromo_recovery.fuzzy_shape import FuzzyShape
from hagoromo_recovery.surface_shape import SurfaceShape

MatterShape: TypeAlias = SurfaceShape | FuzzyShape
SHAPES: dict[Law, type[SurfaceShape] | type[FuzzyShape]] = {"surface": SurfaceShape, "fuzzy": FuzzyShape}
