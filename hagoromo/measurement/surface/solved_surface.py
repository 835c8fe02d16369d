"""Solved surface: normals and points of a capture of unknown shape, and the light that the surface sends to itself."""

from __future__ import annotations

import warnings
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from hagoromo.cluster.cluster import Workers
from hagoromo.files.record import decode, read_json
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel
from hagoromo.measurement.normals.normals import NormalMap, solve_normals, solve_with_one_lobe
from hagoromo.measurement.normals.views import FEWEST_LAMPS
from hagoromo.measurement.surface.cast_shadows import cast_shadows
from hagoromo.measurement.surface.depth import DepthSurface, surface_from_normals, surface_of
from hagoromo.measurement.surface.own_light import NOTABLE, OwnLight, Values, own_light, without
from hagoromo.measurement.surface.shape import SIMPLE, has_near_lamps, solve_shape
from hagoromo.measurement.surface.tile_pixels import Coarse
from hagoromo.measurement.surface.tile_store import FolderSource, Source, binned, coarse_factor, tile_store
from hagoromo.measurement.surface.tiles import Fine, solve_coarse, solve_tiles
from hagoromo.photograph.capture import Capture, capture_file, count_absent, load_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.transforms import CaptureRecord
from hagoromo.progress import Progress, part_of, silent

OwnLightUse = Literal["report", "subtract"]
OWN_LIGHT_ROUNDS = 3  # of subtracting it and solving again: body colours have settled to 2 % then
LARGEST_CAPTURE_BYTES = 4 * 2**30  # largest memory of a capture that is solved without tiles
SOLVE_BYTES_PER_VALUE = (
    100  # of a value: value, variance, light, model and weights in double precision, and their copies
)
SECONDS_PER_VALUE = 2.8e-6  # of a pixel in a photograph, on one core: 12 Mpixel under 96 lamps took 53 minutes
SMOOTH = 1.8  # times as long where normals of tiles are smoothed: of 192² pixels under 16 lamps 2.3, more lamps less
STORING_SHARE, COARSE_SHARE = 0.3, 0.1  # shares of the time: writing tiles, solving the reduced capture


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
    shadows = cast_shadows(normals, normals.views.valid(capture.photographs))
    return normals, surface_of(normals, camera, distance, shadows=shadows)


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


def large_source(folder: str | Path) -> FolderSource | None:
    """The photographs of a capture of unknown shape that is too large to be solved as one; None for any other."""
    file = capture_file(folder)
    top = decode(read_json(file), CaptureRecord, str(file))
    if top.points_path is not None and top.normals_path is not None:
        return None
    frames = top.frames
    present = tuple(i for i, frame in enumerate(frames) if not count_absent(file, [frame]))
    if not present:
        return None
    first = load_capture(folder, slice(present[0], present[0] + 1))
    large = needs_tiles(first.photographs[0], len(present))
    return FolderSource(Path(folder), present, name=first.own_name) if large else None


def coarse_or_whole(folder: str | Path) -> Capture:
    """The capture of a folder; of one that `large_source` gives, means over squares of pixels, read one at a time."""
    source = large_source(folder)
    first = None if source is None else load_capture(folder, slice(source.frames[0], source.frames[0] + 1))
    if source is None or first is None or first.points is not None:
        return load_capture(folder)
    photographs = (source.photograph(k) for k in range(source.count))
    small = tuple(binned(one, coarse_factor(one.camera)) for one in photographs)
    return Capture(small, first.name, first.folder)


def needs_tiles(photograph: Photograph, count: int) -> bool:
    """Whether `count` photographs of this size are too large to be solved as one."""
    return SOLVE_BYTES_PER_VALUE * float(photograph.values.size) * count > LARGEST_CAPTURE_BYTES


def expected_time(source: Source, processes: int) -> str:
    """What to expect of `solve_large`: how many values, and about how long on so many processes of a core each."""
    pixels = source.photograph(0).values.shape
    values = float(pixels[0] * pixels[1]) * source.count
    longer = SMOOTH if source.count >= 2 * FEWEST_LAMPS else 1.0
    minutes = longer * SECONDS_PER_VALUE * values / processes / 60.0
    many = f"{processes} process" + ("es" if processes > 1 else "")
    return (
        f"{source.count} photographs of {pixels[1]} × {pixels[0]} px in tiles: about {max(minutes, 1.0):.0f} min "
        f"with {many}"
    )


def solve_large(
    source: Source,
    scratch: Path,
    distance: float,
    progress: Progress = silent,
    model: GlossModel = BY_EVIDENCE,
    workers: Workers | None = None,
) -> tuple[Coarse, Fine]:
    """The solution for a small capture of means over squares of pixels, and the full-size maps.

    scratch: folder for temporary files. distance: first guess of the distance to the surface [m].
    workers: who solves the tiles; see `solve_tiles`.
    """
    progress(0.0, expected_time(source, 1 if workers is None else max(getattr(workers, "workers", 1), 1)))
    with tile_store(source, scratch, part_of(progress, 0.0, STORING_SHARE)) as store:
        coarse = solve_coarse(store, distance, None, part_of(progress, STORING_SHARE, COARSE_SHARE), model)
        shown = part_of(progress, STORING_SHARE + COARSE_SHARE, 1.0 - STORING_SHARE - COARSE_SHARE)
        fine = solve_tiles(store, coarse, shown, workers=workers)
    return coarse, fine
