"""Own gloss: ln β, ln γ and the tail of each pixel of a solved surface, and how they vary over each material."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.gloss.gloss_map import remark_on_variation
from hagoromo.measurement.normals.shading import TAIL
from hagoromo.reflectance.parameters import OF_LOBES

Array = NDArray[np.float64]

OWN = np.array([0, 1, TAIL])  # places in a row of `Gloss` of what a pixel has of its own


@dataclass(frozen=True, eq=False)
class OwnGloss:
    """Gloss of each of P pixels: value (P, 3) ln β, ln γ and tail 1/ν of the first lobe of its material, and its
    covariance (P, 3, 3). The other lobes of a pixel are as much wider and stronger as the first one.
    """

    value: Array
    covariance: Array

    def pixels(self, chosen: NDArray) -> OwnGloss:
        """That of some pixels."""
        return OwnGloss(self.value[chosen], self.covariance[chosen])


@dataclass(frozen=True)
class OwnGlossTest:
    """The test of a material for a gloss that varies.

    varies: whether there is evidence for it. spread: standard deviations of ln β, ln γ and the tail 1/ν over the
    pixels; 0 where that does not vary.
    log_evidence: ln odds against one gloss. gain: share of the loss of photographs left out, in the highlights, by
    which a gloss per pixel lowers it, and the p-value of that, 1 where it was not tested. chi_square: per value, of one
    gloss and of a gloss per pixel. converged: share of the pixels.
    """

    varies: bool
    spread: tuple[float, float, float]
    log_evidence: float
    gain: float
    p_value: float
    chi_square: tuple[float, float]
    converged: float

    def record(self) -> dict[str, Any]:
        """The entry `gloss` in materials.json."""
        return {
            "per_pixel": self.varies,
            "variation": dict(zip((*OF_LOBES, "tail"), self.spread, strict=True)),
            "log_evidence": self.log_evidence,
            "left_out": {"gain": self.gain, "p_value": self.p_value},
            "chi_square": {"shared": self.chi_square[0], "per_pixel": self.chi_square[1]},
            "convergence": {"pixels": self.converged},
        }

    def remarks(self) -> list[str]:
        """One line if the gloss varies, and one if the fit of pixels did not converge."""
        if not self.varies:
            return []
        *variation, by_tail = self.spread
        tails = f", 1/ν by {by_tail:.2g}" if by_tail > 0.0 else ""
        found = [
            f"{remark_on_variation(variation, tails)}. In the highlights of photographs were left out the error is "
            f"{100.0 * self.gain:.0f} % less with it"
        ]
        if self.converged < 1.0:
            found.append(f"the gloss of {100.0 * (1.0 - self.converged):.2g} % of the pixels did not converge")
        return found
