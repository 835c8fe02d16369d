"""The demo's measurement held against the truth: which material is which, and how often the intervals hold it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response, camera_response, camera_white
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.measurement import Measurement
from hagoromo.reflectance.material.material_estimate import PARAMETERS, MaterialEstimate
from hagoromo.reflectance.reflectance import Reflectance

COVERAGE = 0.95


@dataclass(frozen=True)
class ParameterRow:
    """One parameter of one material: truth, estimate, 95 % interval, and whether the photographs determine it."""

    material: str
    parameter: str
    true: float
    estimate: float
    low: float
    high: float
    identifiable: bool

    @property
    def inside(self) -> bool:
        """Whether the interval holds the truth."""
        return self.low <= self.true <= self.high

    def record(self) -> dict[str, Any]:
        """Plain figures."""
        return asdict(self) | {"inside": self.inside}


def named(measurement: Measurement, surface: NDArray[np.integer], names: Sequence[str]) -> Measurement:
    """`measurement` with each material called after the sample that most of its pixels lie on (for reading only).

    surface: (height, width) index into `names`, −1 for none. `InputError` when two materials lie on one sample.
    """
    materials = []
    for number, material in enumerate(measurement.materials):
        samples = surface[(measurement.labels == number) & (surface >= 0)]
        materials.append(replace(material, name=names[int(np.bincount(samples, minlength=len(names)).argmax())]))
    if sorted(material.name for material in materials) != sorted(names):
        places = ", ".join(material.name for material in materials)
        raise InputError(
            f"the samples are {', '.join(names)} and the materials found lie on {places}: light them better"
        )
    return replace(measurement, materials=tuple(materials))


def rightly_labelled(measurement: Measurement, surface: NDArray[np.integer], names: Sequence[str]) -> float:
    """Share of the labelled pixels whose label is that of the sample they lie on."""
    number = np.array([names.index(material.name) for material in measurement.materials])
    known = (measurement.labels >= 0) & (surface >= 0)
    return float(np.mean(number[measurement.labels[known]] == surface[known]))


def rows(
    materials: Sequence[MaterialEstimate], truth: Mapping[str, Reflectance], response: Response, lamp: Spectrum
) -> list[ParameterRow]:
    """Every parameter beside its truth, expressed as the estimate expresses it: body colours have mean 1."""
    table = []
    for material in sorted(materials, key=lambda one: list(truth).index(one.name)):
        true = truth[material.name]
        colour = camera_response(true.body_colour, lamp, response) / camera_white(lamp, response)
        values = {key: getattr(true, key) for key in PARAMETERS} | {"alpha": true.alpha * float(colour.mean())}
        for key in PARAMETERS:
            low, high = material.interval_95[key]
            identifiable = material.identifiable[key]
            table.append(ParameterRow(material.name, key, values[key], getattr(material, key), low, high, identifiable))
        identifiable, share = material.identifiable["alpha"], colour / colour.mean()
        for k, channel in enumerate(response.channels):
            low, high = material.interval_95["body_colour"][k]
            table.append(
                ParameterRow(
                    material.name, f"c_{channel}", float(share[k]), material.body_colour[k], low, high, identifiable
                )
            )
    return table


def coverage(table: Sequence[ParameterRow]) -> dict[str, Any]:
    """How many intervals of identifiable parameters hold the truth, and how likely so few would be if all were right.

    likelihood: P(at most that many inside) for independent intervals of COVERAGE; those of one material are not quite.
    """
    from scipy.stats import binom

    identifiable = [row for row in table if row.identifiable]
    inside = sum(row.inside for row in identifiable)
    return {
        "intervals": len(table),
        "identifiable": len(identifiable),
        "inside": inside,
        "expected": COVERAGE * len(identifiable),
        "likelihood": float(binom.cdf(inside, len(identifiable), COVERAGE)),
    }
