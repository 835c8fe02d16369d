"""Lobe estimate: the further lobes of a material with errors and intervals, and what is to be said of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from hagoromo.least_squares.loss import log_interval
from hagoromo.measurement.normals.photometric_model import Fit
from hagoromo.measurement.normals.shading import N
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.parameters import GAMMA_RANGE
from hagoromo.reflectance.interface_albedo import interface_albedo

OPEN_STRENGTH = 1.0  # standard error of ln β from which the strength of a lobe is called open: a factor of 7
Lobe = tuple[float, float]  # β and γ, or the standard errors of their logarithms


@dataclass(frozen=True)
class FurtherLobes:
    """Lobes of a material but the first: β, of the interface colour of mean 1, and γ [rad] of each; relative: the
    standard errors of ln β and ln γ; gain: share of the squared error of photographs left out that all lobes take off.
    """

    lobes: tuple[Lobe, ...] = ()
    relative: tuple[Lobe, ...] = ()
    gain: float = 0.0

    @staticmethod
    def of(fit: Fit, number: int, shift: Array) -> FurtherLobes:
        """Those of material `number`; shift: (2,) of ln β and ln γ by which the highlight is off its model."""
        if fit.lobes is None:
            return FurtherLobes()
        mean = float(fit.gloss.colour[number].mean())
        lobes = tuple((beta * mean, gamma) for beta, gamma in fit.lobes.each[number])
        relative: tuple[Lobe, ...] = ()
        if fit.lobes.covariances:
            variance = np.diag(fit.lobes.covariances[number]).reshape(-1, 2) + shift**2
            relative = tuple((float(beta), float(gamma)) for beta, gamma in np.sqrt(variance))
        return FurtherLobes(lobes, relative, fit.lobes.gains[number])

    @property
    def albedo(self) -> float:
        """The specular albedo that they add."""
        return sum(beta * float(interface_albedo(gamma, N)[0]) for beta, gamma in self.lobes)

    def errors(self) -> tuple[Lobe, ...]:
        """Standard errors of β and γ."""
        return tuple((beta * b, gamma * g) for (beta, gamma), (b, g) in self._pairs())

    def intervals(self) -> tuple[Any, ...]:
        """95 % intervals of β and γ; of β (0, infinity) where the photographs do not bound it."""
        return tuple((log_interval(beta, b), width_interval(gamma, g)) for (beta, gamma), (b, g) in self._pairs())

    def remarks(self) -> list[str]:
        """One line for all of them, and one for those whose strength the photographs leave open."""
        if not self.lobes:
            return []
        widths = ", ".join(
            f"{math.degrees(gamma):.2g}° ± {math.degrees(gamma * error):.1g}°"
            for (_, gamma), (_, error) in self._pairs()
        )
        found = [
            f"one lobe is not enough: further ones of half width {widths} take {100.0 * self.gain:.0f} % off "
            "the squared error of photographs that were left out"
        ]
        unbounded = [f"{math.degrees(gamma):.2g}°" for (_, gamma), (error, _) in self._pairs() if error > OPEN_STRENGTH]
        if unbounded:
            found.append(
                f"the photographs leave open how strong the lobe of half width {', '.join(unbounded)} is, as its peak "
                "is clipped or falls between the lamps: add a shorter exposure, or lamps a degree apart around it"
            )
        return found

    def _pairs(self) -> list[tuple[Lobe, Lobe]]:
        return list(zip(self.lobes, self.relative, strict=False))


def width_interval(gamma: float, relative: float) -> tuple[float, float]:
    """95 % interval of a half width [rad] with this standard error of its logarithm, within its admissible range."""
    low, high = np.clip(log_interval(gamma, relative), *GAMMA_RANGE)
    return float(low), float(high)
