"""Solved surface: normals and points of a capture of unknown shape, and the light that the surface sends to itself."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel
from hagoromo.measurement.normals.normals import NormalMap, solve_normals, solve_with_one_lobe
from hagoromo.measurement.surface.depth import DepthSurface, surface_from_normals
from hagoromo.measurement.surface.own_light import NOTABLE, OwnLight, Values, own_light, without
from hagoromo.measurement.surface.shape import SIMPLE, has_near_lamps, solve_shape
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, part_of, silent

OwnLightUse = Literal["report", "subtract"]
OWN_LIGHT_ROUNDS = 3  # of subtracting it and solving again: body colours have settled to 2 % then


@dataclass(frozen=True, eq=False)
class SolvedSurface:
    """normal_map, surface; own_light: of the surface; added: what of it was subtracted from each photograph (h, w, C)
    before the surface was solved.
    """

    normal_map: NormalMap
    surface: DepthSurface
    own_light: OwnLight
    added: tuple[Values, ...] = ()

    def described(self, measurement: Measurement) -> Measurement:
        """`measurement` of this surface with its own light: as a map, in remarks, and in what was predicted."""
        remarks = [self.own_light.remark(measurement.labels == number) for number in range(len(measurement.materials))]
        materials = tuple(
            material if remark is None else replace(material, remarks=(*material.remarks, remark))
            for material, remark in zip(measurement.materials, remarks, strict=True)
        )
        predicted = measurement.predicted
        if self.added:
            predicted = tuple((one + part).astype(np.float32) for one, part in zip(predicted, self.added, strict=True))
        return replace(measurement, materials=materials, predicted=predicted, own_light=self.own_light)


def solve_surface(
    capture: Capture,
    distance: float,
    progress: Progress = silent,
    model: GlossModel = BY_EVIDENCE,
    use: OwnLightUse = "report",
) -> SolvedSurface:
    """The surface in `capture`; distance: to it [m]. use: what to do with the light that the surface sends to itself.

    "subtract": solve again without it, OWN_LIGHT_ROUNDS times. Warns where lamps and photographs have different
    units, so that nothing can be subtracted.
    """
    share = 1.0 / (1 + OWN_LIGHT_ROUNDS) if use == "subtract" else 1.0
    solved = _solve(capture, distance, part_of(progress, 0.0, share), model)
    found, parts = own_light(capture, *solved)
    if use == "report" or found.up_to < NOTABLE:
        return SolvedSurface(*solved, found)
    if not found.possible:
        warnings.warn(
            f"the body of the object would reflect {100 * found.albedo:.0f} % of the light: lamps and photographs have "
            "different units, and the light that the object sends to itself is not subtracted",
            stacklevel=4,
        )
        return SolvedSurface(*solved, found)
    for turn in range(OWN_LIGHT_ROUNDS):
        added, shown = parts, part_of(progress, (1 + turn) * share, share)
        last = turn == OWN_LIGHT_ROUNDS - 1
        solved = (_solve if last else _solve_simply)(without(capture, parts), distance, shown, model)
        found, parts = own_light(capture, *solved)
    return SolvedSurface(*solved, replace(found, subtracted=True), tuple(added))


def _solve(capture: Capture, distance: float, progress: Progress, model: GlossModel) -> tuple[NormalMap, DepthSurface]:
    """Normals and points of a capture of unknown shape."""
    if has_near_lamps(capture):
        shape = solve_shape(capture, distance, progress=progress, model=model)
        return shape.normal_map, shape.surface
    normals = solve_normals(capture, progress=progress, model=model)
    camera = capture.photographs[0].camera
    return normals, surface_from_normals(normals.normals, camera, distance, normals.variance)


def _solve_simply(
    capture: Capture, distance: float, progress: Progress, _: GlossModel
) -> tuple[NormalMap, DepthSurface]:
    """As `_solve`, with one Gaussian lobe and a neutral interface, for the rounds before the last."""
    if has_near_lamps(capture):
        return _solve(capture, distance, progress, SIMPLE)
    normals = solve_with_one_lobe(capture, progress=progress, model=SIMPLE)
    return normals, surface_from_normals(
        normals.normals, capture.photographs[0].camera, distance, normals.variance, draws=0
    )
