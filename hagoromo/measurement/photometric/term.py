"""Term: a part of the photometric model that photographs of a capture have in common, with one unknown.

    recorded = (1 + Σ_t u_t m_t) reading + Σ_t u_t a_t

Each `Term` says once what a unit of its unknown u adds to the readings of a photograph (a) or multiplies them by (m),
what is known of u before the photographs, and its words. The registry is `terms`; fits know only this file.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.record import ForeignRecord, about
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph

Array = NDArray[np.float64]

UNDETERMINED = 0.9  # share of the standard error before the photographs that is left, from which they say nothing
SURPRISING = 2.5  # of its spreads from what was expected, beyond which an unknown is doubted (p = 0.01)
MOST_DARKENED = 0.1  # smallest factor of readings, whatever the unknowns are


class ReadingChange(NamedTuple):
    """What a unit of the unknown adds to the readings of a photograph, and what share of themselves it adds to them.

    Each broadcasts with the values (h, w, C). added: in units of the values.
    """

    added: Any = 0.0
    share: Any = 0.0


@dataclass(frozen=True)
class Term:
    """A row of the table of terms.

    name: in records, files and the option `estimate`. words: what it is. unit: of its unknown u, after the number.
    mean, spread: of u before the photographs, a normal law on the `range` of u; source: where that is from.
    change: what a unit of u changes in a photograph.
    """

    name: str
    words: str
    unit: str
    mean: float
    spread: float
    range: tuple[float, float]
    source: str
    change: Callable[[Photograph], ReadingChange]


class TermEstimate(ForeignRecord, frozen=True, kw_only=True):
    """What photographs say of the unknown of a term."""

    value: Annotated[float, about("the unknown, as it was taken out of the photographs")]
    standard_error: Annotated[float, about("its standard error")]
    unit: Annotated[str, about("what one of it is")] = ""
    determined: Annotated[bool, about("whether the photographs say more than was known before")] = True
    sentence: Annotated[str, about("the same in words")] = ""


@dataclass(frozen=True, eq=False)
class CaptureTerms:
    """Terms of a capture: values (T,) of their unknowns, and covariance (T, T). rounds: of the fit that gave them."""

    terms: tuple[Term, ...]
    values: Array
    covariance: Array
    rounds: int = 0

    @staticmethod
    def before(terms: Sequence[Term]) -> CaptureTerms:
        """What is known before the photographs."""
        spreads = np.array([term.spread for term in terms])
        return CaptureTerms(tuple(terms), np.array([term.mean for term in terms]), np.diag(spreads**2))

    @property
    def errors(self) -> Array:
        """(T,) standard errors."""
        return np.sqrt(np.diag(self.covariance))

    def without(self, capture: Capture) -> Capture:
        """`capture` with photographs as they would be if all unknowns were 0; their noise is what it was."""
        photographs = []
        for photograph in capture.photographs:
            added, share = self._sums([term.change(photograph) for term in self.terms])
            factor = np.maximum(1.0 + share, MOST_DARKENED)
            values = (photograph.values - added) / factor
            photographs.append(replace(photograph, values=values, variance=photograph.variance / factor**2))
        return replace(capture, photographs=tuple(photographs))

    def _sums(self, changes: Sequence[ReadingChange]) -> tuple[Any, Any]:
        pairs = list(zip(self.values.tolist(), changes, strict=True))
        return sum(u * one.added for u, one in pairs), sum(u * one.share for u, one in pairs)

    def estimates(self) -> dict[str, TermEstimate]:
        """Name of each term → its estimate."""
        triples = zip(self.terms, self.values.tolist(), self.errors.tolist(), strict=True)
        return {term.name: _estimate(term, value, error) for term, value, error in triples}


def _estimate(term: Term, value: float, error: float) -> TermEstimate:
    determined = error < UNDETERMINED * term.spread
    before = f"{term.mean:g} ± {term.spread:g} before the photographs ({term.source})"
    decimals = max(-math.floor(math.log10(error)), 0)
    found = f"{term.words}: {value:.{decimals}f} ± {error:.{decimals}f} {term.unit}"
    said = "estimated from the photographs and taken out of them" if determined else "these photographs do not show it"
    if abs(value - term.mean) > SURPRISING * term.spread:
        said += ", which is far more than expected: something else in them looks like it"
    return TermEstimate(
        value=value,
        standard_error=error,
        unit=term.unit,
        determined=determined,
        sentence=f"{found}, {said}; {before}",
    )
