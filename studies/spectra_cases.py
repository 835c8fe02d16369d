"""The cases of the spectra study: whose spectra are estimated, from what, with which priors, and how well.

No spectrum that is tested is in a prior: near copies of the charts' patches are taken out of "surfaces"; people and
surfaces are kept out by turns.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.reflectance.spectra.prior_spectra import apart, surfaces
from hagoromo.reflectance.spectra.reflectance_prior import UNLIKE_SURFACES
from studies.spectra_bench import SPECTRA_NOISE, TARGETS, Array, SpectraBench, chart, delta_e, noisy

FOLDS = 10
REGION = 7.815  # χ² of three degrees of freedom at 95 %
CHART_NAMES = ("BabelColor Average", "ISO 17321-1")


@dataclass(frozen=True, eq=False)
class SpectraCase:
    """Surfaces (m, wavelengths), and per surface the priors and the training spectra, none of which is tested."""

    name: str
    tested: Array
    priors: Sequence[Sequence[hg.ReflectancePrior]]
    training: Sequence[Array]


def chart_case(skin: Array | None) -> SpectraCase:
    """The chart's 24 patches; skin is among the priors where it is given."""
    training = others_than_charts()
    priors = [
        hg.ReflectancePrior.from_spectra("surfaces", training, UNLIKE_SURFACES),
        hg.ReflectancePrior.load("smooth"),
    ]
    if skin is not None:
        priors.append(hg.ReflectancePrior.from_spectra("skin", skin))
    tested = chart()
    return SpectraCase("chart", tested, [priors] * len(tested), [training] * len(tested))


def others_than_charts() -> Array:
    """The surfaces of the prior without near copies of a chart's patches."""
    return apart(surfaces(), np.concatenate([chart(name) for name in CHART_NAMES]))


def skin_cases(skin: Array) -> tuple[SpectraCase, SpectraCase]:
    """People's skin, each person kept out of the prior: with the prior of skin alone, and with the class unknown."""
    turns = _turns(len(skin))
    others = [skin[turns != turn] for turn in range(FOLDS)]
    own = [hg.ReflectancePrior.from_spectra("skin", of) for of in others]
    general = [hg.ReflectancePrior.load("surfaces"), hg.ReflectancePrior.load("smooth")]
    training = [others[turn] for turn in turns]
    return (
        SpectraCase("skin", skin, [[own[turn]] for turn in turns], training),
        SpectraCase("skin, class unknown", skin, [[*general, own[turn]] for turn in turns], training),
    )


def surfaces_case() -> SpectraCase:
    """The surfaces themselves, each kept out of the prior."""
    surfaces = others_than_charts()
    turns = _turns(len(surfaces))
    others = [surfaces[turns != turn] for turn in range(FOLDS)]
    own = [hg.ReflectancePrior.from_spectra("surfaces", of, UNLIKE_SURFACES) for of in others]
    smooth = hg.ReflectancePrior.load("smooth")
    return SpectraCase(
        "surfaces kept out", surfaces, [[own[turn], smooth] for turn in turns], [others[turn] for turn in turns]
    )


def estimate(case: SpectraCase, matrix: Array, random: np.random.Generator) -> list[hg.SpectrumEstimate]:
    """One estimate a surface, from noisy readings through `matrix` (channels, wavelengths)."""
    estimates = []
    for truth, priors in zip(case.tested, case.priors, strict=True):
        values = noisy(matrix @ truth, random)
        estimates.append(hg.estimate_spectrum(matrix, values, np.diag((SPECTRA_NOISE * values) ** 2), priors))
    return estimates


def study_case(case: SpectraCase, bench: SpectraBench, sources: str, seed: int = 0) -> dict[str, Any]:
    """Every camera in turn: {"delta_e": lamp → (cameras, m), "inside": the same, "camera_b": …, "probability": …}.

    camera_b: what every other camera reads under D65 and A: relative errors (pairs, m, 3) and the share inside.
    """
    random = np.random.default_rng(seed)
    off: dict[str, list] = {lamp: [] for lamp in TARGETS}
    inside: dict[str, list] = {lamp: [] for lamp in TARGETS}
    other: dict[str, list] = {lamp: [] for lamp in ("D65", "A")}
    other_inside: list[float] = []
    probability = []
    for camera in bench.cameras:
        estimates = estimate(case, bench.readings(camera, sources), random)
        values, errors = np.array([f.values for f in estimates]), np.array([f.covariance for f in estimates])
        probability.append(np.mean([list(f.probability.values()) for f in estimates], axis=0))
        for lamp, matrix in bench.colours.items():
            off[lamp].append(delta_e(values @ matrix.T, case.tested @ matrix.T, matrix.sum(axis=1)))
            inside[lamp].append(_inside(matrix, values - case.tested, errors))
        for lamp, of_lamp in other.items():
            for matrix in (bench.cameras[name][lamp] for name in bench.cameras if name != camera):
                of_lamp.append((values - case.tested) @ matrix.T / (case.tested @ matrix.T))
                other_inside.append(float(np.mean(_inside(matrix, values - case.tested, errors))))
    names = list(dict.fromkeys(prior.name for prior in case.priors[0]))
    return {
        "delta_e": {lamp: np.array(rows) for lamp, rows in off.items()},
        "coverage": {lamp: float(np.mean(rows)) for lamp, rows in inside.items()},
        "camera_b": {lamp: np.abs(np.array(rows)) for lamp, rows in other.items()},
        "camera_b_coverage": float(np.mean(other_inside)),
        "probability": dict(zip(names, np.mean(probability, axis=0).tolist(), strict=True)),
    }


def _inside(matrix: Array, off: Array, errors: Array) -> Array:
    """(m,): whether each error (m, wavelengths), seen through `matrix` (3, wavelengths), lies in its 95 % region."""
    projected, spread = off @ matrix.T, matrix @ errors @ matrix.T
    return np.einsum("ma,ma->m", projected, np.linalg.solve(spread, projected[..., None])[..., 0]) < REGION


def _turns(count: int) -> NDArray[np.int64]:
    """The turn (count,) in which each is kept out, shuffled once and for all."""
    return np.random.default_rng(1).permutation(count) % FOLDS
