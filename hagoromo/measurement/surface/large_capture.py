"""Photographs of unknown shape that do not fit the memory: read one at a time and solved tile by tile."""

from __future__ import annotations

from pathlib import Path

from hagoromo.cluster.cluster import Workers
from hagoromo.files.record import decode, read_json
from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel
from hagoromo.measurement.surface.tile_store import FolderSource, Source, binned, coarse_factor, tile_store
from hagoromo.measurement.surface.tiles import Coarse, Fine, solve_coarse, solve_tiles
from hagoromo.photograph.capture import Capture, capture_file, count_absent, load_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.transforms import CaptureRecord
from hagoromo.progress import Progress, part_of, silent

LARGEST_CAPTURE_BYTES = 4 * 2**30  # largest memory of a capture that is solved without tiles
SOLVE_BYTES_PER_VALUE = (
    100  # of a value: value, variance, light, model and weights in double precision, and their copies
)
STORING_SHARE, COARSE_SHARE = 0.3, 0.1  # shares of the time: writing tiles, solving the reduced capture


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

    with tile_store(source, scratch, part_of(progress, 0.0, STORING_SHARE)) as store:
        coarse = solve_coarse(store, distance, None, part_of(progress, STORING_SHARE, COARSE_SHARE), model)
        shown = part_of(progress, STORING_SHARE + COARSE_SHARE, 1.0 - STORING_SHARE - COARSE_SHARE)
        fine = solve_tiles(store, coarse, shown, workers=workers)
    return coarse, fine
