"""Measure photographs that do not fit the memory: read one at a time, solved tile by tile.

Materials, residuals and the report are those of a small capture of pixel means; normals, points, body colours and
labels are full size.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import read_json
from hagoromo.measurement.known_shape import Measurement
from hagoromo.measurement.normals.gloss_estimate import measurement_of
from hagoromo.measurement.surface.tile_store import FolderSource, Source, tile_store
from hagoromo.measurement.surface.tiles import Fine, solve_coarse, solve_tiles
from hagoromo.photograph.capture import TRANSFORMS, Capture, count_absent, load_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.progress import Progress, part_of, silent

LARGEST_CAPTURE_BYTES = 4 * 2**30  # bytes that the photographs of a capture may need for it to be solved as one
# value, variance, light, model and weights in double precision, and their copies
SOLVE_BYTES_PER_VALUE = 100
STORING_SHARE, COARSE_SHARE = 0.3, 0.1  # shares of the work


def large_source(folder: str | Path) -> FolderSource | None:
    """The photographs of a capture of unknown shape that is too large to be solved as one; None for any other."""
    file = Path(folder) if Path(folder).suffix == ".json" else Path(folder) / TRANSFORMS
    record = read_json(file)
    frames = record.get("frames")
    if not isinstance(frames, list) or ("points_path" in record and "normals_path" in record):
        return None
    present = tuple(i for i, frame in enumerate(frames) if not count_absent(file, [frame]))
    if not present:
        return None
    first = load_capture(folder, slice(present[0], present[0] + 1)).photographs[0]
    return FolderSource(Path(folder), present) if needs_tiles(first, len(present)) else None


def needs_tiles(photograph: Photograph, count: int) -> bool:
    """Whether `count` photographs like this are too large to be solved as one."""
    return SOLVE_BYTES_PER_VALUE * float(photograph.values.size) * count > LARGEST_CAPTURE_BYTES


def solve_large(
    source: Source, home: Path, distance: float, progress: Progress = silent
) -> tuple[Measurement, Capture, Fine]:
    """The measurement of the small capture of `source`, that capture with its shape, and the full-size maps.

    home: folder for the scratch. distance: about, to the surface [m].
    """
    with tile_store(source, home, part_of(progress, 0.0, STORING_SHARE)) as store:
        coarse = solve_coarse(store, distance, progress=part_of(progress, STORING_SHARE, COARSE_SHARE))
        fine = solve_tiles(
            store, coarse, part_of(progress, STORING_SHARE + COARSE_SHARE, 1.0 - STORING_SHARE - COARSE_SHARE)
        )
        measured = measurement_of(coarse.capture, coarse.found)
        materials = [replace(one, remarks=(*one.remarks, *fine.remarks())) for one in measured.materials]
        measured = replace(measured, materials=tuple(materials))
        small = replace(coarse.capture, points=coarse.surface.points, normals=coarse.found.normals)
    return measured, small, fine


def write_fine(fine: Fine, home: Path) -> None:
    """The full-size maps: normals.exr, points.exr, variance.exr, body.exr, labels.png."""
    normals, points = np.moveaxis(fine.normals, 2, 0), np.moveaxis(fine.points, 2, 0)
    channels = "RGB" if fine.body.shape[2] == 3 else map(str, range(fine.body.shape[2]))
    write_exr(home / "normals.exr", dict(zip(("N.X", "N.Y", "N.Z"), normals, strict=True)))
    write_exr(home / "points.exr", dict(zip(("P.X", "P.Y", "P.Z"), points, strict=True)))
    write_exr(home / "variance.exr", {"normal": fine.variance, "distance": fine.depth_variance})
    write_exr(home / "body.exr", dict(zip(channels, np.moveaxis(fine.body, 2, 0), strict=True)))
    write_png(home / "labels.png", (fine.labels + 1).astype(np.uint8))
