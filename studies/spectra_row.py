"""A row of the study of spectra from colours: what one method makes of one case."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class SpectraRow:
    """One line of the table. delta_e: lamp → (cameras, surfaces). More: what our own estimate states beside it."""

    case: str
    sources: str
    method: str
    delta_e: Mapping[str, np.ndarray]
    more: Mapping[str, Any]

    def record(self) -> dict[str, Any]:
        """As results.json has it: medians and 95th percentiles."""
        scores = {lamp: percentiles(values) for lamp, values in self.delta_e.items()}
        return {"case": self.case, "sources": self.sources, "method": self.method, "delta_e_2000": scores, **self.more}


def percentiles(values: np.ndarray) -> dict[str, float]:
    """Median and 95th percentile."""
    return {"median": float(np.median(values)), "p95": float(np.percentile(values, 95))}
