"""The 80 measured materials of MERL as published fits: what the files hold, and the reflectance that they stand for.

Two fits of each: shifted-gamma facets with an own lobe per channel (Bagher, Soler & Holzschuch 2012) and the ABC
microfacets (Löw, Kronander, Ynnerman & Unger 2012). Reflectances are times cosθ_i, as eq. (2) has them [1/sr].
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from msgspec import structs
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.files.record import ForeignRecord, Positive, Vector, decode

Array = NDArray[np.float64]


class ShiftedGammaRecord(ForeignRecord, frozen=True, rename={"lambda_": "lambda"}):
    """A material of merl_sgd.json; three numbers: red, green, blue."""

    name: str
    rhoD: Vector
    rhoS: Vector
    alpha: Vector
    p: Vector
    f0: Vector
    f1: Vector
    kap: Vector
    lambda_: Vector
    c: Vector
    k: Vector
    theta0: Vector


class AbcRecord(ForeignRecord, frozen=True):
    """A material of merl_abc.json; three numbers: red, green, blue."""

    name: str
    kD: Vector
    A: Vector
    B: Positive
    C: float
    ior: Positive


Truth = Callable[[hg.Cosines], Array]


def read_truths(folder: str | Path) -> dict[str, dict[str, Truth]]:
    """The fits in `folder`, which has merl_sgd.json and merl_abc.json: kind of fit → material → its reflectance."""
    home = Path(folder)
    return {
        "shifted gamma": _read(home / "merl_sgd.json", ShiftedGammaRecord, shifted_gamma),
        "ABC": _read(home / "merl_abc.json", AbcRecord, abc),
    }


def shifted_gamma(of: dict[str, Array], cosines: hg.Cosines) -> Array:
    """(N, 3) cosθ_i/π (ρ_d + ρ_s D F G₁(θ_i) G₁(θ_r) / (cosθ_i cosθ_r)), Bagher et al. eq. (9)–(16)."""
    tan2 = 1.0 / cosines.half**2 - 1.0
    x = of["alpha"] + tan2 / of["alpha"]
    density = of["kap"] * np.exp(-x) / (np.pi * x ** of["p"] * cosines.half**4)
    fresnel = of["f0"] - of["f1"] * cosines.deviation + (1.0 - of["f0"]) * (1.0 - cosines.deviation) ** 5

    def unmasked(cosine: Array) -> Array:
        beyond = np.maximum(np.arccos(cosine) - of["theta0"], 0.0)
        with np.errstate(over="ignore"):  # c reaches 1e38, where nothing is left beyond θ₀
            return np.clip(1.0 + of["lambda_"] * (1.0 - np.exp(of["c"] * beyond ** of["k"])), 0.0, 1.0)

    interface = density * fresnel * unmasked(cosines.incidence) * unmasked(cosines.view) / cosines.view
    return (of["rhoD"] * cosines.incidence + of["rhoS"] * interface) / np.pi


def abc(of: dict[str, Any], cosines: hg.Cosines) -> Array:
    """(N, 3) cosθ_i k_d/π + A F G / ((1 + B (1 − cosφ))^C π cosθ_r), Löw et al. eq. (10), G of eq. (6)."""
    density = of["A"] / (1.0 + of["B"] * (1.0 - cosines.half)) ** of["C"]
    c = cosines.deviation
    g = np.sqrt(np.maximum(of["ior"] ** 2 + c**2 - 1.0, 0.0))
    fresnel = 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + ((c * (g + c) - 1.0) / (c * (g - c) + 1.0)) ** 2)
    masking = np.minimum(1.0, 2.0 * cosines.half * np.minimum(cosines.view, cosines.incidence) / c)
    return (of["kD"] * cosines.incidence + density * fresnel * masking / cosines.view) / np.pi


def _read(
    path: Path, kind: type[ForeignRecord], model: Callable[[dict[str, Any], hg.Cosines], Array]
) -> dict[str, Truth]:
    record = hg.read_json(path)
    if not isinstance(record, list) or not record:
        raise hg.InputError(f"{path} must be a list of materials: given {type(record).__name__}")
    truths: dict[str, Truth] = {}
    for i, entry in enumerate(record):
        fields = structs.asdict(decode(entry, kind, f"{path} material {i + 1}"))
        of = {key: np.array(value) if isinstance(value, tuple) else value for key, value in fields.items()}
        truths[fields["name"]] = lambda cosines, of=of: model(of, cosines)
    return truths
