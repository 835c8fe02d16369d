"""Fit status: how a fit ended: converged, stalled (no step lowers the cost any more) or out of steps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Status(IntEnum):
    """How a fit ended."""

    CONVERGED = 0
    STALLED = 1
    OUT_OF_STEPS = 2

    @property
    def words(self) -> str:
        """As reports and files have it."""
        return ("converged", "stalled", "out of steps")[self]


@dataclass(frozen=True)
class FitStatus:
    """How one fit ended.

    steps: those that it took. cost: ½ χ² or the sum of the loss, at the end. gradient: norm of the cost's gradient
    there, NaN where it was not computed. last_step: size of the last accepted step, in the fit's own coordinates.
    """

    status: Status
    steps: int
    cost: float = float("nan")
    gradient: float = float("nan")
    last_step: float = float("nan")

    @property
    def converged(self) -> bool:
        """Whether the fit is at a minimum, within its tolerance."""
        return self.status == Status.CONVERGED

    def record(self) -> dict[str, Any]:
        """As JSON files have it: numbers that are unknown are null."""
        numbers = {"cost": self.cost, "gradient": self.gradient, "last_step": self.last_step}
        known = {key: value if np.isfinite(value) else None for key, value in numbers.items()}
        return {"status": self.status.words, "steps": self.steps, **known}

    @staticmethod
    def from_record(record: Mapping[str, Any]) -> FitStatus:
        """The inverse of `record`."""
        status = next(one for one in Status if one.words == record["status"])
        keys = ("cost", "gradient", "last_step")
        numbers = (float("nan") if record.get(key) is None else float(record[key]) for key in keys)
        return FitStatus(status, int(record["steps"]), *numbers)

    def remark(self, name: str) -> str:
        """One line for people about the fit of `name`."""
        if self.converged:
            return f"the fit of {name} converged in {self.steps} steps"
        numbers = (("gradient", self.gradient), ("last step", self.last_step))
        known = ", ".join(f"{key} {value:.2g}" for key, value in numbers if np.isfinite(value))
        beside = f" ({known})" if known else ""
        ended = "stalled" if self.status == Status.STALLED else "did not converge"
        return f"the fit of {name} {ended} after {self.steps} steps{beside}: its result is not at a minimum"


@dataclass(frozen=True, eq=False)
class FitStatuses:
    """How K fits ended: arrays (K,) of what `FitStatus` has."""

    status: NDArray[np.int64]
    steps: NDArray[np.int64]
    cost: NDArray[np.float64]
    gradient: NDArray[np.float64]
    last_step: NDArray[np.float64]

    @property
    def converged(self) -> NDArray[np.bool_]:
        """(K,)"""
        return self.status == Status.CONVERGED

    def __getitem__(self, fit: int) -> FitStatus:
        """That of one fit."""
        return FitStatus(
            Status(int(self.status[fit])),
            int(self.steps[fit]),
            float(self.cost[fit]),
            float(self.gradient[fit]),
            float(self.last_step[fit]),
        )


def scipy_status(result: Any) -> FitStatus:
    """How a fit by `scipy.optimize` (least_squares, lsq_linear, minimize) ended."""
    steps = int(getattr(result, "nfev", None) or getattr(result, "nit", 0) or 0)
    cost = getattr(result, "cost", None)
    gradient = getattr(result, "grad", None)
    return FitStatus(
        Status.CONVERGED if result.success else Status.OUT_OF_STEPS,
        steps,
        float(result.fun if cost is None else cost),
        float("nan") if gradient is None else float(np.linalg.norm(gradient)),
    )
