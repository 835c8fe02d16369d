"""Reflectance table: values of a BRDF for pairs of directions, as instruments give them, and the material of them.

Axes of the sample: its normal is +z. A value is the BRDF [1/sr], without the cosine of the incidence; our f of eq. (2)
has that cosine.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from hagoromo.errors import InputError
from hagoromo.measurement.material.estimate import estimate_material
from hagoromo.measurement.material.model_choice import Facets, Interface
from hagoromo.measurement.observations import MOST_VALUES, Observations, evenly_drawn
from hagoromo.measurement.parameters import check_index
from hagoromo.measurement.sight import Array, Sight
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.torrance_sparrow import Cosines

UNIT = 1e-3  # largest difference from 1 of the length of a direction
LEAST_SQUARE = 1e-12  # of the cosine between lamp and half vector: lamp and eye opposite each other have no half vector


@dataclass(frozen=True, eq=False)
class ReflectanceTable:
    """A BRDF at N pairs of directions in C channels.

    to_lamp, to_eye: (N, 3) unit, away from the sample, whose normal is +z. values: (N, C) BRDF [1/sr]. variance: (N, C)
    of the values [1/sr²]; None: the table states none. channels: their names.
    `InputError` for other shapes, directions that are not unit, and numbers that are not finite.
    """

    to_lamp: Array
    to_eye: Array
    values: Array
    variance: Array | None = None
    channels: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        for name in ("to_lamp", "to_eye", "values", "variance"):
            given = getattr(self, name)
            if given is not None:
                object.__setattr__(self, name, np.asarray(given, np.float64))
        count, shape = len(self.to_lamp), self.values.shape
        if self.values.ndim != 2 or self.to_lamp.shape != (count, 3) or self.to_eye.shape != (count, 3):
            raise InputError(
                f"a table of reflectances has directions (N, 3) and values (N, C): given {self.to_lamp.shape}, "
                f"{self.to_eye.shape} and {shape}"
            )
        if len(self.values) != count or (self.variance is not None and self.variance.shape != shape):
            raise InputError(f"{count} pairs of directions have values of shape {shape}: give one row for each pair")
        if not np.isfinite(self.values).all():
            raise InputError("a table of reflectances has values that are not finite: leave those rows out")
        if self.variance is not None and not (np.isfinite(self.variance).all() and (self.variance > 0.0).all()):
            raise InputError("a table of reflectances needs a variance above 0: state one for each value")
        for name, way in (("to_lamp", self.to_lamp), ("to_eye", self.to_eye)):
            lengths = np.linalg.norm(way, axis=1)
            if not (np.abs(lengths - 1.0) < UNIT).all():
                worst = int(np.nanargmax(np.abs(np.nan_to_num(lengths, nan=np.inf) - 1.0)))
                raise InputError(f"{name} of row {worst} has the length {lengths[worst]:.4g}: give unit directions")

    def with_relative_error(self, error: float) -> ReflectanceTable:
        """The table with a variance: `error` times each value, and a thousandth of that times the largest."""
        if not (np.isfinite(error) and error > 0.0):
            raise InputError(f"the relative error of a table is {error:g}: give a number above 0, such as 0.01")
        floor = 1e-3 * np.abs(self.values).max(axis=0, initial=0.0)
        return replace(self, variance=(error * np.maximum(np.abs(self.values), np.maximum(floor, 1e-12))) ** 2)

    @property
    def cosines(self) -> Cosines:
        """The four cosines (N, 1) of each pair."""
        deviation = np.sqrt(np.maximum(0.5 + 0.5 * np.einsum("ni,ni->n", self.to_lamp, self.to_eye), LEAST_SQUARE))
        incidence, view = self.to_lamp[:, 2], self.to_eye[:, 2]
        half = np.clip(0.5 * (incidence + view) / deviation, -1.0, 1.0)
        return Cosines(*(cosine[:, None] for cosine in (incidence, view, half, deviation)))

    def thinned(self, most: int, seed: int = 0) -> ReflectanceTable:
        """`most` of the values at most, drawn so that every range of the half angle φ is equally represented."""
        limit = most // self.values.shape[1]
        if len(self.values) <= limit:
            return self
        rows = evenly_drawn(np.arccos(self.cosines.half[:, 0]), limit, seed)
        variance = None if self.variance is None else self.variance[rows]
        return replace(self, to_lamp=self.to_lamp[rows], to_eye=self.to_eye[rows], values=self.values[rows],
                       variance=variance)  # fmt: skip

    def fit(
        self, name: str = "table", n: float | None = None, facets: Facets = "auto", interface: Interface = "auto"
    ) -> MaterialEstimate:
        """The material of the table, of as many of its rows as a fit takes: see `fit_table`."""
        check_index(n)
        rows = self.thinned(MOST_VALUES)
        return estimate_material(rows.observations(), name, len(rows.values), n=n, facets=facets, interface=interface)

    def observations(self) -> Observations:
        """The rows as the samples that a material is fitted to; `InputError` without a variance."""
        if self.variance is None:
            raise InputError("the table states no variance: give one, or a relative error of its values")
        cosines = self.cosines
        facing = np.maximum(cosines.incidence, 0.0)
        values, places = self.values * facing, np.arange(len(self.values))
        sight = Sight(cosines, np.ones((len(values), 1, values.shape[1])))
        used = np.broadcast_to(sight.fit_to_use[:, None], values.shape)
        noise = np.maximum(self.variance * facing**2, np.finfo(float).tiny)
        return Observations(
            values, noise, np.zeros_like(values), used, sight, np.full(values.shape, np.inf), places, places
        )


def fit_table(
    to_lamp: ArrayLike,
    to_eye: ArrayLike,
    values: ArrayLike,
    variance: ArrayLike,
    name: str = "table",
    n: float | None = None,
    facets: Facets = "auto",
    interface: Interface = "auto",
    channels: Sequence[str] = (),
) -> MaterialEstimate:
    """The material of a measured BRDF: α, β, γ, n and body colour with 95 % intervals, see `estimate_material`.

    to_lamp, to_eye: (N, 3) unit directions away from the sample, whose normal is +z. values: (N, C) BRDF [1/sr].
    variance: (N, C) [1/sr²]. n: refractive index, where it is known. facets: Gaussian, with tails (student-t), or by
    evidence (auto). interface: in the colour of the lamp (neutral), coloured, or by evidence (auto). channels: names.
    Rows beyond 80° from the normal are left out; of large tables as many rows are drawn as a fit takes.
    `InputError` for other shapes, too few rows, and a fit that does not converge.

    >>> lamp, eye = np.meshgrid(np.radians([0, 15, 30, 45, 60]), np.radians(np.arange(-70, 71, 5)), indexing="ij")
    >>> lamp, eye = (np.stack([np.sin(a), 0 * a, np.cos(a)], -1).reshape(-1, 3) for a in (lamp, eye))
    >>> chalk = np.full((len(lamp), 3), 0.8 / np.pi)
    >>> material = hg.fit_table(lamp, eye, chalk, (0.01 * chalk) ** 2, name="chalk")
    >>> bool(abs(np.pi * material.alpha * max(material.body_colour) - 0.8) < 0.01)
    True
    """
    arrays = (np.asarray(array, np.float64) for array in (to_lamp, to_eye, values, variance))
    return ReflectanceTable(*arrays, channels=tuple(channels)).fit(name, n, facets, interface)
