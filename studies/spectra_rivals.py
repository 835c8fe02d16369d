"""What others do with a camera's RGB: a matrix, root polynomials, Wiener's estimate, and spectra from CIE colours.

Each gives, for readings (m, 3) under D65, the XYZ (m, 3) under every target lamp. All learn from the case's training
but one, the bound: Wiener's estimate that has learnt the very surfaces it is tested on, the best linear one there is.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS
from studies.spectra_bench import SPECTRA_NOISE, TARGETS, Array, SpectraBench, delta_e, noisy
from studies.spectra_cases import SpectraCase

RIVAL_LAMP = "D65"
BOUND = "Wiener that knows the tested"
RECOVERIES = ("Jakob 2019", "Meng 2015", "Otsu 2018", "Smits 1999", "Mallett 2019")
ROOT_DEGREE = 2
Method = Callable[[Array, Array, Array, Array], Array]  # matrix, target matrix, training, readings → XYZ


def study_rivals(case: SpectraCase, bench: SpectraBench, seed: int = 0) -> dict[str, dict[str, Array]]:
    """Method → lamp → ΔE00 (cameras, m)."""
    methods: dict[str, Method] = {"3×3 matrix": _linear, "root polynomial": _root, "Wiener": _wiener, BOUND: _wiener}
    errors: dict[str, dict[str, list]] = {name: {lamp: [] for lamp in TARGETS} for name in methods}
    random = np.random.default_rng(seed)
    groups = _groups(case)
    for camera in bench.cameras:
        matrix = bench.readings(camera, RIVAL_LAMP)
        readings = noisy(case.tested @ matrix.T, random)
        for name, method in methods.items():
            for lamp, target in bench.colours.items():
                xyz = np.empty_like(readings)
                for training, rows in groups:
                    known = case.tested if name == BOUND else training
                    xyz[rows] = method(matrix, target, known, readings[rows])
                errors[name][lamp].append(delta_e(xyz, case.tested @ target.T, target.sum(axis=1)))
    return {name: {lamp: np.array(rows) for lamp, rows in of.items()} for name, of in errors.items()}


def study_recoveries(case: SpectraCase, bench: SpectraBench, seed: int = 0) -> dict[str, dict[str, Array]]:
    """Method → lamp → ΔE00 of colour-science's recoveries, given the exact XYZ under D65, and through a camera.

    Through a camera, XYZ is that of the root polynomial: "Meng 2015 through a camera".
    """
    target = bench.colours[RIVAL_LAMP]
    errors = {name: _scores(case, bench, [_recovered(name, case.tested @ target.T)]) for name in RECOVERIES}
    random = np.random.default_rng(seed)
    colours = []
    for camera in bench.cameras:
        matrix = bench.readings(camera, RIVAL_LAMP)
        colours.append(_root(matrix, target, case.training[0], noisy(case.tested @ matrix.T, random)))
    for name in RECOVERIES:
        spectra = [_recovered(name, np.clip(xyz, 1e-3, 1.2)) for xyz in colours]
        errors[f"{name} through a camera"] = _scores(case, bench, spectra)
    return errors


def _scores(case: SpectraCase, bench: SpectraBench, spectra: list[Array]) -> dict[str, Array]:
    return {
        lamp: np.array([delta_e(of @ m.T, case.tested @ m.T, m.sum(axis=1)) for of in spectra])
        for lamp, m in bench.colours.items()
    }


def _groups(case: SpectraCase) -> list[tuple[Array, list[int]]]:
    """Each set of training spectra with the surfaces that it is for."""
    sets = {id(training): training for training in case.training}
    return [(of, [i for i, t in enumerate(case.training) if id(t) == key]) for key, of in sets.items()]


def _linear(matrix: Array, target: Array, training: Array, readings: Array) -> Array:
    return readings @ np.linalg.lstsq(training @ matrix.T, training @ target.T, rcond=None)[0]


def _root(matrix: Array, target: Array, training: Array, readings: Array) -> Array:
    """Finlayson, Mackiewicz and Hurlbert 2015, "Color correction using root-polynomial regression"."""
    from colour.characterisation import polynomial_expansion_Finlayson2015

    expand = [polynomial_expansion_Finlayson2015(of, ROOT_DEGREE, True) for of in (training @ matrix.T, readings)]
    return expand[1] @ np.linalg.lstsq(expand[0], training @ target.T, rcond=None)[0]


def _wiener(matrix: Array, target: Array, training: Array, readings: Array) -> Array:
    """The plain linear estimate: one Gaussian over the training spectra."""
    mean, kernel = training.mean(axis=0), np.cov(training.T)
    xyz = []
    for values in readings:
        total = matrix @ kernel @ matrix.T + np.diag((SPECTRA_NOISE * values) ** 2)
        xyz.append(target @ (mean + kernel @ matrix.T @ np.linalg.solve(total, values - matrix @ mean)))
    return np.array(xyz)


def _recovered(name: str, xyz: Array) -> Array:
    """Spectra (m, wavelengths) of CIE colours (m, 3) under D65."""
    import colour
    from colour import recovery

    def observer(shape: Any) -> tuple[Any, Any]:
        table = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"].copy().align(shape)
        return table, colour.SDS_ILLUMINANTS[RIVAL_LAMP].copy().align(shape)

    ours = observer(colour.SpectralShape(WAVELENGTHS[0], WAVELENGTHS[-1], WAVELENGTHS[1] - WAVELENGTHS[0]))
    of: dict[str, Callable[[Array], Any]] = {
        "Jakob 2019": lambda seen: recovery.XYZ_to_sd_Jakob2019(seen, *ours),
        "Meng 2015": lambda seen: recovery.XYZ_to_sd_Meng2015(seen, *ours),
        "Otsu 2018": lambda seen: recovery.XYZ_to_sd_Otsu2018(seen, *observer(recovery.SPECTRAL_SHAPE_OTSU2018)),
        "Smits 1999": lambda seen: recovery.RGB_to_sd_Smits1999(hg.srgb_from_xyz(seen)),
        "Mallett 2019": lambda seen: recovery.RGB_to_sd_Mallett2019(hg.srgb_from_xyz(seen)),
    }
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # that a colour lies outside a method's own gamut
        curves = [of[name](row) for row in xyz]
    return np.array([np.interp(WAVELENGTHS, curve.wavelengths, curve.values) for curve in curves])
