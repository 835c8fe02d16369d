"""Measure: the materials and the surface of an object, from its photographs under known lamps.

Enters: a capture, in memory or in its folder. Leaves: a Measurement. The method follows from the capture: with known
shape the materials are fitted; under far lamps normals are solved and integrated; under near lamps normals and depth
are solved together; photographs too large for the memory are solved in tiles.
"""

from __future__ import annotations

import tempfile
import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import get_args

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from hagoromo.camera.camera import Camera
from hagoromo.cluster.cluster import Workers, here_or_on
from hagoromo.errors import InputError
from hagoromo.measurement.error_files import SharedErrors
from hagoromo.measurement.health.examine import Examined, examine
from hagoromo.measurement.known_shape import SEED, measure_known_shape, terms_of_known_shape, with_separation
from hagoromo.measurement.lamp_departure import fitted_rig, lamp_departure
from hagoromo.measurement.material.body_map import BodyMap
from hagoromo.measurement.material.body_spectra import body_spectra
from hagoromo.measurement.material.model_choice import Facets, Interface, check_model
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.normals.gloss_choice import GlossModel
from hagoromo.measurement.normals.gloss_estimate import measurement_of, solved_gloss_map
from hagoromo.measurement.normals.normal_profile import terms_of_unknown_shape, with_term_errors
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.photometric.term import CaptureTerms, Term
from hagoromo.measurement.photometric.terms import terms_named
from hagoromo.measurement.stillness import Stillness, stillness
from hagoromo.measurement.surface.depth import DepthSurface
from hagoromo.measurement.surface.solved_surface import OwnLightUse, large_source, solve_large, solve_surface
from hagoromo.measurement.surface.tile_store import FolderSource
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.rig import Rig
from hagoromo.progress import Progress, part_of, silent

FITTING_SHARE = 0.3  # approximate share of the time, of fitting a rig
TERMS_SHARE = 0.6  # of estimating what photographs have in common
UNKNOWN_DISTANCE = 1.0  # [m] from the camera, where it is unknown and only sets the scale of the points


def measure(
    capture: Capture | str | Path,
    *,
    n: float | None = None,
    distance: float | None = None,
    across: float | None = None,
    labels: NDArray[np.integer] | None = None,
    colour_from_highlights: bool = False,
    facets: Facets = "auto",
    interface: Interface = "auto",
    own_light: OwnLightUse = "report",
    estimate: Sequence[str] = (),
    rig: Rig | str | Path | None = None,
    scratch: str | Path | None = None,
    progress: Progress = silent,
    scheduler: str | int | None = None,
) -> Measurement:
    """The materials and the surface of `capture`: a Capture, or the path of a capture folder.

    With points and normals in the capture, its materials are fitted (`measure_known_shape`). Otherwise four lamps or
    more are needed: far lamps give normals (`solve_normals`), which are integrated to points at `distance`; near lamps
    give normals and points together (`solve_shape`). Photographs in a folder that need more than 4 GiB are read one at
    a time and solved in tiles; a Capture in memory is always solved as one.

    n: refractive index where it is known; of a capture with known shape only. distance: from the camera to an object of
    unknown shape [m], by default to the world's origin, or 1 m where the camera stands there and all lamps are far;
    under near lamps it is a first guess. across: what the longer side of the picture shows at the object [m], in place
    of the distance; an orthographic view has no other scale. labels: (h, w) materials
    0, 1, …, −1 unknown, and colour_from_highlights: whether to measure the colour of the lamps; both of a capture with
    known shape only. facets: "gaussian", "student-t" (with tails, whose ν is estimated) or "auto": with tails where
    there is evidence for them. interface: "neutral" (the colour of the lamp), "coloured" or "auto". own_light: what to
    do with the light that an object of unknown shape sends to itself: "report" it, or "subtract" it and solve again.
    estimate: names of what else all photographs have in common (`terms_named` lists them): it is estimated and taken
    out of them, see `terms.json`. Photographs that are solved in tiles have none.
    rig: the lamps beside one another, a Rig or its file (`calibrate_rig`): photographs are divided by the strength and
    fall-off of their lamp; of an object of unknown shape the photographs say how much of the differences in strength
    holds (in tiles: all of it), and what is measured is that of the photographs so evened. scratch: folder for the
    temporary files of tiles (default: the system's). progress: called with the share of the work done (0 … 1) and the
    name of the step. scheduler: see `render`; its workers solve the tiles, in a scratch folder that all must see, with
    the same bits; what is solved as one is solved here.

    Warns of photographs that moved, and where the shading shows that their values are not linear in light. Raises
    `InputError` for a capture that can be measured in no way.
    """
    check_model(facets, interface)
    settings = {
        "n": n,
        "distance_m": distance,
        "across_m": across,
        "colour_from_highlights": colour_from_highlights or None,
    }
    settings |= {key: of for key, of in (("facets", facets), ("interface", interface)) if of != "auto"}
    settings |= {"own_light": own_light} if own_light != "report" else {}
    settings |= {"estimate": list(estimate)} if estimate else {}
    if own_light not in get_args(OwnLightUse):
        raise InputError(f"own_light is {own_light!r}: it is 'report' or 'subtract'")
    wanted = Wanted(n, labels, colour_from_highlights, facets, interface, own_light, terms_named(estimate))
    rig = Rig.load(rig) if isinstance(rig, (str, Path)) else rig
    where = Where(distance, across, scratch, scheduler)
    # Threads of BLAS wait for each other longer than its small systems take: half of the CPU time on a busy machine.
    with threadpool_limits(limits=1, user_api="blas"):
        measurement = _assumed(_measured(capture, wanted, where, progress, rig))
    stated = {key: value for key, value in settings.items() if value is not None}
    return replace(measurement, settings=stated, seed=SEED)


@dataclass(frozen=True, eq=False)
class Wanted:
    """What is asked for: see `measure`."""

    n: float | None
    labels: NDArray[np.integer] | None
    colour_from_highlights: bool
    facets: Facets
    interface: Interface
    own_light: OwnLightUse = "report"
    terms: tuple[Term, ...] = ()

    @property
    def model(self) -> GlossModel:
        """Of facets and interface, where the shape is unknown."""
        return GlossModel(self.facets, self.interface)

    def check_unknown_shape(self) -> None:
        """`InputError` where something is asked that has no effect on a capture of unknown shape."""
        if self.n is not None:
            raise InputError(
                "with unknown shape the refractive index has no effect: omit n (--n), or give the capture its shape"
            )
        if self.labels is not None or self.colour_from_highlights:
            raise InputError(
                "with unknown shape, labels and colour_from_highlights have no effect: omit them, or give the shape"
            )


@dataclass(frozen=True)
class Where:
    """Where the object is, and where it is measured: see `measure`."""

    distance: float | None
    across: float | None
    scratch: str | Path | None
    scheduler: str | int | None

    def seen_by(self, camera: Camera) -> Where:
        """With `across` as a distance; `InputError` where both are stated, or what is stated is no scale."""
        if self.across is None:
            if self.distance is not None and camera.orthographic:
                raise InputError(
                    "the view is orthographic, as no focal length is known, and then a distance gives no scale: give "
                    "what the longer side of the picture shows at the object (--across) [m], or capture with --camera"
                )
            return self
        if self.distance is not None:
            raise InputError("distance and across both give the scale: state one of them (--distance, --across)")
        if not (np.isfinite(self.across) and self.across > 0.0):
            raise InputError(f"across is {self.across}: what the longer side of the picture shows [m], above 0")
        return replace(self, distance=self.across * max(camera.focal) / max(camera.width, camera.height), across=None)


def _measured(
    capture: Capture | str | Path, wanted: Wanted, where: Where, progress: Progress, rig: Rig | None = None
) -> Measurement:
    """`measure`, without its settings."""
    if not isinstance(capture, Capture):
        source = large_source(capture)
        if source is not None:
            if wanted.terms:
                raise InputError(
                    f"photographs as large as these are solved in tiles, and {wanted.terms[0].name} cannot be estimated"
                    " then: reduce them, or leave --estimate out"
                )
            source = replace(source, rig=rig)
            first = source.photograph(0)
            away = _distance(first, where.seen_by(first.camera).distance, wanted)
            home = Path(where.scratch or tempfile.gettempdir())
            with here_or_on(where.scheduler) as workers:
                return replace(_measure_tiles(source, home, away, progress, wanted.model, workers), rig=rig)
    whole = capture if isinstance(capture, Capture) else load_capture(capture)
    where = where.seen_by(whole.photographs[0].camera)
    if rig is None:
        return _measured_whole(whole, wanted, where, progress)
    return _under(rig, whole, wanted, where, progress)


def _under(rig: Rig, capture: Capture, wanted: Wanted, where: Where, progress: Progress) -> Measurement:
    """`_measured_whole`, with lamps evened by the strengths of `rig`, or by the share of them that fits."""
    share = 1.0
    if capture.points is None or capture.normals is None:
        away = _distance(capture.photographs[0], where.distance, wanted)
        where = replace(where, distance=away)
        rig, share = fitted_rig(rig, capture, away, part_of(progress, 0.0, FITTING_SHARE))
    shown = part_of(progress, FITTING_SHARE, 1.0 - FITTING_SHARE)
    measurement = _measured_whole(rig.evened_capture(capture), wanted, where, shown)
    return replace(measurement, rig=rig, rig_share=share)


def _measured_whole(capture: Capture, wanted: Wanted, where: Where, progress: Progress) -> Measurement:
    """The measurement of a capture in memory, whose lamps are even."""
    if where.scheduler is not None:
        warnings.warn("the capture is measured here: only large ones of unknown shape have tiles", stacklevel=3)
    still = _warn_of_motion(capture)
    if capture.points is not None and capture.normals is not None:
        return _with_health(_of_known_shape(capture, wanted, progress), examine(capture, still))
    away = _distance(capture.photographs[0], where.distance, wanted)
    if any(lamp.to_lamp is None for shot in capture.photographs for lamp in shot.lamps):
        measured = _of_unknown_shape(capture, wanted, away, progress)
        return _with_health(measured, examine(measured.capture or capture, still))
    found = examine(capture, still)  # before the shape is solved: its lamps may be stronger than stated
    return _with_health(_of_unknown_shape(found.with_strengths(capture), wanted, away, progress), found)


def _with_health(measurement: Measurement, found: Examined) -> Measurement:
    """The measurement with what was found of its photographs."""
    return replace(measurement, health=found.health, linearity=found.exponent)


def _of_known_shape(capture: Capture, wanted: Wanted, progress: Progress) -> Measurement:
    settings = wanted.labels, wanted.n, wanted.colour_from_highlights
    terms = None
    if wanted.terms:
        terms = terms_of_known_shape(capture, wanted.terms, *settings, wanted.facets, wanted.interface)
        capture = terms.without(capture)
    measurement = measure_known_shape(capture, *settings, progress, wanted.facets, wanted.interface, terms)
    measurement = replace(measurement, points=capture.points, capture=capture)
    return _described(capture, measurement, terms)


def _of_unknown_shape(capture: Capture, wanted: Wanted, distance: float, progress: Progress) -> Measurement:
    terms = None
    if wanted.terms:
        shown, progress = part_of(progress, 0.0, TERMS_SHARE), part_of(progress, TERMS_SHARE, 1.0 - TERMS_SHARE)
        terms = terms_of_unknown_shape(capture, wanted.terms, distance, wanted.model, shown)
        capture = terms.without(capture)
    solved = solve_surface(capture, distance, progress, wanted.model, wanted.own_light)
    normal_map = solved.normal_map if terms is None else with_term_errors(capture, terms, solved.normal_map)
    measurement = solved.described(with_solved_shape(capture, normal_map, solved.surface))
    assert measurement.capture is not None
    return _described(capture, with_separation(measurement.capture, measurement), terms)


def _described(capture: Capture, measurement: Measurement, terms: CaptureTerms | None) -> Measurement:
    """`measurement` of `capture`, which lacks `terms`, with spectra of the bodies and what the terms are."""
    spectra = body_spectra(capture, measurement.materials)
    return replace(measurement, body_spectra=spectra, terms={} if terms is None else terms.estimates())


def _measure_tiles(
    source: FolderSource,
    scratch: Path,
    distance: float,
    progress: Progress,
    model: GlossModel,
    workers: Workers | None,
) -> Measurement:
    coarse, fine = solve_large(source, scratch, distance, progress, model, workers)
    capture = replace(coarse.capture, name=source.name)
    measurement = with_solved_shape(capture, coarse.normal_map, coarse.surface)
    materials = tuple(replace(one, remarks=(*one.remarks, *fine.remarks())) for one in measurement.materials)
    return replace(measurement, materials=materials, body_spectra=body_spectra(coarse.capture, materials), fine=fine)


def with_solved_shape(capture: Capture, normals: NormalMap, surface: DepthSurface) -> Measurement:
    """The Measurement of `capture`, whose shape was solved."""
    measurement, modes = measurement_of(capture, normals), normals.modes
    return replace(
        measurement,
        points=surface.points,
        body=BodyMap(
            normals.body,
            normals.body_error,
            measurement.materials,
            measurement.labels,
            gloss=solved_gloss_map(normals, measurement.materials, measurement.labels),
        ),
        normal_variance=normals.variance,
        distance_variance=surface.variance,
        summed_variance=None if normals.fit.smooth is None else normals.own_variance,
        shared_errors=None if modes is None or surface.modes is None else SharedErrors(modes, surface.modes),
        capture=replace(capture, points=surface.points, normals=normals.normals),
        normal_map=normals,
    )


def _assumed(measurement: Measurement) -> Measurement:
    """The measurement with what its capture takes for given, and a loud line where the shading contradicts it."""
    capture = measurement.capture
    if capture is None:
        return measurement
    if measurement.health is None:
        measurement = _with_health(measurement, examine(capture))
    found = measurement.linearity
    assert measurement.health is not None
    transfer, order = (measurement.health[name] for name in ("transfer", "order"))
    said = f"not tested: {transfer.said}" if found is None else found.sentence
    if order.state == "doubtful":
        warnings.warn(f"{order.said}: {order.advice}", stacklevel=3)
    if found is not None and found.contradicted:
        stated = capture.assumptions.get("transfer")
        warnings.warn(f"{said}{f' (transfer: {stated})' if stated else ''}: {found.advice}", stacklevel=3)
    taken = {**capture.assumptions, "linearity": said}
    taken |= {name: one.sentence for name, one in measurement.terms.items()}
    if measurement.own_light is not None and measurement.own_light.shadows:
        taken["light in shadows"] = measurement.own_light.shadows
    solved = measurement.normal_map
    departure = None if solved is None else lamp_departure(solved, [one.lamps[0] for one in capture.photographs])
    if departure is not None and departure.significant:
        taken["lamps"] = f"{taken.get('lamps', 'as stated')}; {departure.sentence}, which the fit allows for"
    if measurement.rig is not None:
        taken["rig"] = (
            f"lamps evened by a rig measured on {', '.join(measurement.rig.sources) or 'something else'}; of its "
            f"differences in strength {measurement.rig_share:.2f} hold here"
        )
    return replace(measurement, assumptions=taken, lamp_departure=departure)


def _warn_of_motion(capture: Capture) -> Stillness | None:
    """Which photographs moved or are blurred, with a warning for each that moved."""
    still = stillness(capture.photographs)
    for name, (x, y) in (still.shifts if still else {}).items():
        warnings.warn(
            f"{name} is shifted by ({x:.1f}, {y:.1f}) px from the other photographs: take it again, or leave it out",
            stacklevel=4,
        )
    return still


def _distance(photograph: Photograph, distance: float | None, wanted: Wanted) -> float:
    """`distance_to`; `InputError`, too, where n, labels … are given."""
    away = distance_to(photograph, distance)
    wanted.check_unknown_shape()
    return away


def distance_to(photograph: Photograph, distance: float | None) -> float:
    """Distance to an object of unknown shape [m]: as stated, else to the world's origin.

    Under far lamps normals, colours and gloss do not depend on it: unknown, it is UNKNOWN_DISTANCE, with a warning.
    `InputError` where it is unknown under near lamps.
    """
    away = float(np.linalg.norm(photograph.camera.position)) if distance is None else distance
    if away == 0.0 and distance is None and all(lamp.position is None for lamp in photograph.lamps):
        warnings.warn(
            f"the distance of the object is unknown: {UNKNOWN_DISTANCE:g} m is taken, which sets the scale of the "
            "points; normals, colours and gloss do not depend on it (give --distance for lengths in metres)",
            stacklevel=5,
        )
        return UNKNOWN_DISTANCE
    if away == 0.0:
        raise InputError(
            "the capture has no shape and its camera stands at the world's origin: give the distance of the object "
            "(--distance) [m]"
        )
    return away
