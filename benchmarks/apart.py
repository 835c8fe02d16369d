"""What it costs to read a file in a process apart, format by format, into docs/reference/apart.md.

    python benchmarks/apart.py [--seconds 3]

Each sample is read as a command reads it, with the library in this process and apart in turn, from warm memory. Counted
is what both processes compute [s].
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import apart_samples
import numpy as np
import psutil

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from fuzz import records
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_views, write_views
from hagoromo.files import apart, hdr
from hagoromo.files.exif import Exif
from hagoromo.files.exr import write_exr
from hagoromo.files.mesh import read_mesh
from hagoromo.files.volume_file import read_volume
from hagoromo.files.whole import write_text
from hagoromo.image.picture.any_picture import read_any_picture
from hagoromo.photograph.development.exposure import StatedExposure, read_exposure
from hagoromo_formats.cameras.lensfun import camera_by_lensfun
from hagoromo_formats.volumes.nrrd_file import write_nrrd
from hagoromo_formats.volumes.openvdb_out import write_openvdb
from tests.inverse.simulated_bracket import write_dng

PAGE = Path(__file__).resolve().parents[1] / "docs" / "reference" / "apart.md"
HEIGHT, WIDTH, SIDE, FINENESS, VIEWS = 3000, 4000, 160, 7, 100
SEED = 0
READ_APART = apart.read_apart
HEADER = "its header apart, its numbers by us"
MB = 1e6
WARM = 2  # readings that are not counted
ROUNDS = 7  # readings that are, at least
INTRODUCTION = """# What is read in a process apart { #apart }

A library in C that decodes a file from outside may crash on it, fill the memory, or never end. It does so in a process
of its own (`hagoromo/files/apart.py`), which

* may take no more memory than is free (Linux);
* may compute for 20 s, and 2 µs more for each byte of the file and 0.1 µs for each byte that the file unpacks to;
* prints nothing, and answers with arrays of numbers or with one line;
* waits for the next file when it is done. Two of them wait at most; one that holds more than 512 MiB is ended.

If it dies, the command says so in one line and ends with status 2, and the next file gets a new process. Its answer is
not trusted: it holds types of numbers and texts alone, within the memory that it names.

A file that reaches one file's process could change what that process answers about a later one: it is no wall against a
library that is taken over, but against one that crashes or takes too much.

What it costs is measured by `python benchmarks/apart.py`: seconds of computing of both processes together, for all that
a command does to read such a file; the least of several readings, as a machine that does much else makes each of them
longer. *Apart* is how much more it is than with the library in the process of the command. Where that is less than a
tenth, a library in C reads apart.
"""
START = """The first file of a command costs the start of the process: {start:.1f} s here.
Load of the machine: {load}. The busier it is, the more a share errs: one below zero shows by how much.
"""
ENDING = """
Some cost more than a tenth and are read apart all the same: what it costs is one copy of the numbers, a few hundredths
of a second for each file.

VTK (`.vti`, `.slc`, `.vtp`), Alembic and USD are not in the table, as not every machine has their libraries: they are
read apart. PyAV only writes films. What Python itself brings (zlib, bz2, XML by expat, JSON, TOML) is used here, with
sizes that are checked first.
"""


class ApartCase(NamedTuple):
    """A file; how a command reads it with its library here, and apart; why it is not read apart, if it is not."""

    name: str
    library: str
    path: Path
    here: Callable[[Path], Any]
    apart: Callable[[Path], Any]
    why_not: str = ""


def main() -> None:
    """Measure, print, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seconds", type=float, default=3.0, help="of computing for each sample")
    parser.add_argument("--out", type=Path, default=PAGE, help="the page")
    asked = parser.parse_args()
    begun = time.perf_counter()
    apart.read_apart(apart_samples.nothing, __file__, "nothing")
    start = time.perf_counter() - begun
    with tempfile.TemporaryDirectory() as home:
        rows = [row_of(case, asked.seconds) for case in cases(Path(home))]
    load = f"{os.getloadavg()[0]:.1f} processes on {os.cpu_count()} cores" if hasattr(os, "getloadavg") else "not known"
    first = START.format(start=start, load=load)
    table = ["| file | library | MB | s here | apart | is read |", "|---|---|---|---|---|---|", *rows]
    write_text(asked.out, "\n".join([INTRODUCTION, first, *table]) + "\n" + ENDING)
    print(f"{asked.out} written")


def row_of(case: ApartCase, seconds: float) -> str:
    """The row of a sample, which is printed, too."""
    here, away = compared(case, seconds)
    size = case.path.stat().st_size / MB
    cells = (
        case.name,
        case.library,
        f"{size:.2g}",
        f"{here:.2g}",
        f"{away / here - 1.0:+.0%}",
        case.why_not or "apart",
    )
    row = f"| {' | '.join(cells)} |"
    print(row, flush=True)
    return row


def compared(case: ApartCase, seconds: float) -> tuple[float, float]:
    """Seconds of computing that one reading takes here and apart: the least of readings in turn."""
    times: tuple[list[float], list[float]] = ([], [])
    ways = (lambda: case.here(case.path), lambda: case.apart(case.path))
    for way in ways:
        for _ in range(WARM):
            way()
    while min(map(len, times)) < ROUNDS or sum(map(sum, times)) < seconds:
        for way, taken in zip(ways, times, strict=True):
            before = computed()
            way()
            taken.append(computed() - before)
    return min(times[0]), min(times[1])


def computed() -> float:
    """Seconds that this process has computed, and those that read apart: that wait, or have ended."""
    times = os.times()
    waiting = sum(_computed_by(each.process.pid) for each in apart._idle)
    return time.process_time() + times.children_user + times.children_system + waiting


def _computed_by(number: int) -> float:
    """Seconds that another process has computed, by its own clock where there is one: others have steps of 10 ms."""
    if sys.platform == "linux":
        return time.clock_gettime((~number << 3) | 2)  # clock_getcpuclockid(3)
    return sum(psutil.Process(number).cpu_times()[:2])


def with_library_here(read: Callable[[Path], Any]) -> Callable[[Path], Any]:
    """The same function, for which this process does what another would."""

    def read_here(path: Path) -> Any:
        holders = [module for module in sys.modules.values() if getattr(module, "read_apart", None) is READ_APART]
        for module in holders:
            vars(module)["read_apart"] = _by_library
        try:
            return read(path)
        finally:
            for module in holders:
                vars(module)["read_apart"] = READ_APART

    return read_here


def _by_library(read: Callable[..., Any], path: str | Path, what: str, *given: Any, stated: float = 0.0) -> Any:
    return {name: np.asarray(array) for name, array in read(Path(path), *given).items()}


def read_by(name: str, library: str, path: Path, read: Callable[[Path], Any], why_not: str = "") -> ApartCase:
    """What commands read apart."""
    return ApartCase(name, library, path, with_library_here(read), read, why_not)


def read_here(name: str, library: str, path: Path, read: Callable[[Path], Any], why_not: str) -> ApartCase:
    """What commands read here; read: a function that the process apart can find."""
    return ApartCase(name, library, path, read, lambda path: READ_APART(read, path, name), why_not)


def cases(home: Path) -> Sequence[ApartCase]:
    """The samples, written into a folder."""
    return [*pictures(home), *others(home), *volumes(home), *not_apart(home)]


def photograph() -> np.ndarray:
    """A smooth picture with noise, as photographs are packed."""
    import cv2

    random = np.random.default_rng(SEED)
    coarse = random.random((HEIGHT // 50, WIDTH // 50, 3)).astype(np.float32)
    fine = cv2.resize(coarse, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
    return np.clip(255.0 * fine + random.normal(0.0, 2.0, fine.shape), 0, 255).astype(np.uint8)


def pictures(home: Path) -> list[ApartCase]:
    """Pictures of 12 megapixels."""
    import cv2
    import tifffile
    from PIL import Image

    picture = photograph()
    Image.fromarray(picture).save(home / "a.jpg", quality=92)
    cv2.imwrite(str(home / "a.png"), picture)
    Image.fromarray(picture).save(home / "lzw.tif", compression="tiff_lzw")
    tifffile.imwrite(home / "plain.tif", picture)
    hdr.write_hdr(home / "a.hdr", picture[::2, ::2].astype(np.float32))
    write_dng(home / "a.dng", (16 * picture[..., 0]).astype(np.uint16))
    small = {name: picture[::3, ::3, k].astype(np.float32) for k, name in enumerate("RGB")}
    write_exr(home / "tiles.exr", small, tile=64)
    linear = StatedExposure(transfer="linear")
    kinds = (
        ("JPEG, 12 Mpx", "Pillow", "a.jpg"), ("PNG, 12 Mpx", "OpenCV", "a.png"),
        ("TIFF, LZW, 12 Mpx", "OpenCV", "lzw.tif"), ("TIFF, plain, 12 Mpx", "tifffile", "plain.tif"),
        ("camera RAW, 12 Mpx", "LibRaw", "a.dng"), ("OpenEXR in tiles, 1.3 Mpx", "OpenEXR", "tiles.exr"),
    )  # fmt: skip
    photographs = [
        read_by(f"photograph: {name}", library, home / file, lambda path: read_exposure(path, linear),
                HEADER if "plain" in name else "") for name, library, file in kinds
    ]  # fmt: skip
    return [*photographs, read_by("map: Radiance HDR, 3 Mpx", "OpenCV", home / "a.hdr", read_any_picture)]


def others(home: Path) -> list[ApartCase]:
    """Cameras, lenses and meshes."""
    import trimesh

    lens = Camera(640, 480, (600.0, 600.0), (320.0, 240.0), (0.1,) + (0.0,) * 7)
    write_views(home / "a.yml", {f"{k}.png": lens.with_pose(np.eye(4)) for k in range(VIEWS)}, "opencv")
    (home / "a.xml").write_text(records.LENSFUN, encoding="utf-8")
    ball = trimesh.creation.icosphere(subdivisions=FINENESS)
    for kind in ("ply", "obj", "stl", "glb"):
        data: Any = ball.export(file_type=kind)
        (home / f"a.{kind}").write_bytes(data.encode() if isinstance(data, str) else data)
    exif = Exif(focal_mm=20.0, camera="Acme Acme One", lens="Acme 20mm f/2")
    return [
        read_by(f"cameras in YAML, {VIEWS} views", "OpenCV", home / "a.yml", read_views),
        read_by("lens in XML", "lensfun", home / "a.xml",
                lambda path: camera_by_lensfun((600, 400), exif, database=path)),
        *(read_by(f"mesh: {kind.upper()}, {len(ball.faces):,} triangles", "trimesh", home / f"a.{kind}", read_mesh)
          for kind in ("ply", "obj", "stl", "glb")),
    ]  # fmt: skip


def lattice() -> np.ndarray:
    """A volume that packs as scans do."""
    random = np.random.default_rng(SEED)
    z, y, x = np.mgrid[:SIDE, :SIDE, :SIDE] / SIDE - 0.5
    inside = 1000.0 * np.exp(-8.0 * (x * x + y * y + z * z)) + random.normal(0.0, 5.0, (SIDE,) * 3)
    return np.where(inside > 200.0, inside, 0.0).astype(np.int16)


def volumes(home: Path) -> list[ApartCase]:
    """Volumes that libraries read."""
    import h5py
    import nibabel
    from PIL import Image

    values = lattice()
    for name in ("a.nii", "a.nii.gz"):
        nibabel.Nifti1Image(values.T, np.eye(4)).to_filename(home / name)
    with h5py.File(home / "a.h5", "w") as file:
        file.create_dataset("density", data=values, chunks=(32, 32, 32), compression="gzip")
    pages = [Image.fromarray(page.astype(np.uint16)) for page in values]
    pages[0].save(home / "stack.tif", save_all=True, append_images=pages[1:], compression="tiff_lzw")
    write_openvdb(home / "a.vdb", {"density": values.astype(np.float32)}, np.diag([1e-3] * 3 + [1.0]))
    kinds = (
        ("NIfTI, gzip", "nibabel", "a.nii.gz"), ("NIfTI, plain", "nibabel", "a.nii"), ("HDF5, gzip", "h5py", "a.h5"),
        ("TIFF stack, LZW", "OpenCV", "stack.tif"), ("OpenVDB", "our own, zlib", "a.vdb"),
    )  # fmt: skip
    return [
        read_by(f"volume: {name}, {SIDE}³", library, home / file, lambda path: np.array(read_volume(path).values),
                HEADER if "plain" in name else "") for name, library, file in kinds
    ]  # fmt: skip


def not_apart(home: Path) -> list[ApartCase]:
    """What is read here: our own code, and what costs too much apart."""
    from numcodecs import Zstd

    picture, values = photograph()[::3, ::3], lattice()
    write_exr(home / "lines.exr", {name: picture[..., k].astype(np.float32) for k, name in enumerate("RGB")})
    write_nrrd(home / "a.nrrd", values, np.eye(4), "a")
    chunk = values[:64, :64, :128].astype(np.float32)
    (home / "chunk").write_bytes(Zstd().encode(np.ascontiguousarray(chunk)))
    records.pictures.exif_jpeg(home / "exif.jpg")
    samples, ours = apart_samples, "here: our own code"
    return [
        read_here("OpenEXR in lines, 1.3 Mpx", "our own, zlib", home / "lines.exr", samples.lines_of_exr, ours),
        read_here(f"volume: NRRD, gzip, {SIDE}³", "our own, zlib", home / "a.nrrd", samples.numbers_behind_a_header,
                  ours),
        read_here("chunk of Zarr, Zstandard, 2 MiB", "numcodecs", home / "chunk", samples.chunk_of_zarr,
                  "here: chunks are many"),
        read_here("EXIF", "tifffile", home / "exif.jpg", samples.exif, "here: Python alone"),
    ]  # fmt: skip


if __name__ == "__main__":
    main()
