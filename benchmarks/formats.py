"""Seconds to write and to read a file of every row of the table of formats.

    python benchmarks/formats.py [--rounds 3]

One sample of each kind: a volume of 128³ floats, a picture of 1024 × 1024 pixels, a ball of 327,680 triangles, 100
cameras. What has a writer of ours is written by it, else by another library. Volumes become boxes and boxes volumes, as
by `hagoromo convert`; all else is read into memory. Medians go to out/bench/formats.json; `benchmarks/page.py` puts
them into docs/performance.md.
"""

from __future__ import annotations

import sys
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from turns import in_turn, medians, options, record

import hagoromo as hg
from hagoromo.camera.formats.camera_file import write_views
from hagoromo.files.format import formats, formats_of
from hagoromo_formats.convert import ConvertOptions

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.ball_scene import BALL, camera, lamp
from tests.inverse.simulated_bracket import write_dng

SIDE, PIXELS, FINENESS, VIEWS = 128, 1024, 7, 100
SEED = 0
LENGTHS = ConvertOptions(voxel_mm=1.0, mean_free_path_mm=50.0)
NO_SAMPLE = {"SLC of VolVis", "NanoVDB", "Alembic"}  # nothing here writes one


class FormatCase(NamedTuple):
    """A file of a format: its size on disk is told beside; write: None where another library wrote it before."""

    file: Path
    sample: str
    read: Callable[[], Any]
    write: Callable[[], Any] | None


def main() -> None:
    """Write and read every sample in turn, and record the medians."""
    asked = options(__doc__, 3).parse_args()
    rows = []
    with tempfile.TemporaryDirectory() as home, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        cases = made(Path(home))
        missing = {form.name for form in formats()} - cases.keys() - NO_SAMPLE
        if missing:
            raise ValueError(f"no sample of {', '.join(sorted(missing))}: add one, or to NO_SAMPLE")
        for form in formats():
            if form.name not in cases:
                continue
            case = cases[form.name]
            frames = {"read": silenced(case.read)} | ({"write": silenced(case.write)} if case.write else {})
            taken = medians(in_turn(frames, asked.rounds))
            rows.append({"format": form.name, "sample": case.sample, "mb": size(case.file) / 1e6, **taken})
            print(rows[-1], flush=True)
    record("formats", rows)


def silenced(work: Callable[[], Any]) -> Callable[[], float]:
    """What is timed gives a number that Dr.Jit takes."""
    return lambda: (work(), 0.0)[1]


def size(path: Path) -> int:
    """Of a file, or of all in a folder [bytes]."""
    return (
        sum(each.stat().st_size for each in path.rglob("*") if each.is_file()) if path.is_dir() else path.stat().st_size
    )


def made(home: Path) -> dict[str, FormatCase]:
    """The sample of every format, by its name."""
    random = np.random.default_rng(SEED)
    return {
        **volumes(home, random), **pictures(home, random), **surfaces(home), **scenes(home), **cameras(home),
        **others(home),
    }  # fmt: skip


def volumes(home: Path, random: np.random.Generator) -> dict[str, FormatCase]:
    """128³ floats 0…1 of low frequencies."""
    import h5py
    import nibabel
    import tifffile

    axes = np.meshgrid(*[np.linspace(0.0, 9.0, SIDE)] * 3, indexing="ij")
    values = (0.5 + 0.5 * np.prod(np.cos(axes), axis=0) * random.uniform(0.9, 1.0, (SIDE,) * 3)).astype(np.float32)
    np.save(home / "volume.npy", values)
    box = home / "volume.zarr"
    hg.convert(home / "volume.npy", box, options=LENGTHS)
    head = f"ObjectType = Image\nNDims = 3\nDimSize = {SIDE} {SIDE} {SIDE}\nElementType = MET_FLOAT\n"
    (home / "volume.mha").write_bytes(f"{head}ElementDataFile = LOCAL\n".encode() + values.tobytes())
    nibabel.save(nibabel.Nifti1Image(values, np.eye(4)), home / "volume.nii")
    with h5py.File(home / "volume.h5", "w") as file:
        file["density"] = values
    (home / f"volume_{SIDE}x{SIDE}x{SIDE}_float32.raw").write_bytes(values.tobytes())
    tifffile.imwrite(home / "volume.tif", values)
    found = {}
    for form in formats_of("volume"):
        file = next(home.glob(f"volume*{form.suffixes[0]}"), home / f"volume{form.suffixes[0]}")
        if form.name in NO_SAMPLE:
            continue
        write = (lambda file=file: hg.convert(box, file, force=True)) if form.writer else None
        if write:
            write()
        read = lambda file=file: hg.convert(file, home / "read.zarr", force=True, options=LENGTHS)  # noqa: E731
        found[form.name] = FormatCase(file, f"{SIDE}³ floats ↔ volume box", read, write)
    loaded, again = hg.load_box(box), home / "again.zarr"
    found["volume box"] = FormatCase(
        box, f"{SIDE}³ voxels", lambda: hg.load_box(box), lambda: loaded.save(again, force=True)
    )
    return found


def pictures(home: Path, random: np.random.Generator) -> dict[str, FormatCase]:
    """1024² pixels with noise."""
    from PIL import Image

    from hagoromo.files.exr import write_exr
    from hagoromo.files.hdr import write_hdr
    from hagoromo.files.png import write_png
    from hagoromo.files.tiff import write_tiff

    ramp = np.linspace(0.1, 0.9, PIXELS)[:, None, None] + 0.02 * random.normal(size=(PIXELS, PIXELS, 3))
    linear = ramp.clip(0.0, 1.0).astype(np.float32)
    eight, sixteen = (255.0 * linear).astype(np.uint8), (65535.0 * linear).astype(np.uint16)
    Image.fromarray(eight).save(home / "picture.jpg", quality=92)
    write_dng(home / "picture.dng", (4000 * linear[..., 0]).astype(np.uint16))
    scene = home / "small.toml"
    scene.write_text(camera((256, 256), 300.0) + lamp("key", 0.5, -1.0, 1.0) + BALL, encoding="utf-8")
    image = hg.render(scene)
    image.save(home / "image.exr")
    channels = {name: linear[..., k] for k, name in enumerate("RGB")}
    writers: dict[str, tuple[str, str, Callable[[Path], Any] | None]] = {
        "OpenEXR": ("picture.exr", "3 floats a pixel", lambda file: write_exr(file, channels)),
        "PNG": ("picture.png", "8 bits, sRGB", lambda file: write_png(file, eight)),
        "Radiance HDR": ("picture.hdr", "R, G, B", lambda file: write_hdr(file, linear)),
        "spectral EXR (Fichet et al.)": (
            "spectral.exr", "a render of 256²",
            lambda file: hg.convert(home / "image.exr", file, "spectral", force=True),
        ),
        "JPEG": ("picture.jpg", "8 bits, sRGB", None),
        "TIFF": ("picture.tif", "16 bits", lambda file: write_tiff(file, sixteen)),
        "camera RAW": ("picture.dng", "a mosaic, DNG", None),
    }  # fmt: skip
    (home / "pictures").mkdir()
    found = {}
    for form in formats():
        if form.name in writers:
            name, sample, writer = writers[form.name]
            file = home / name if writer is None else home / "pictures" / name
            write = None if writer is None else lambda writer=writer, file=file: writer(file)
            if write:
                write()
            found[form.name] = FormatCase(file, sample, lambda form=form, file=file: form.read(file), write)
    return found


def surfaces(home: Path) -> dict[str, FormatCase]:
    """A ball of 327,680 triangles."""
    import trimesh

    ball = trimesh.creation.icosphere(subdivisions=FINENESS)
    base, sample = home / "ball.ply", f"{len(ball.faces):,} triangles"
    ball.export(base)
    (home / "ball.vtp").write_text(vtp(np.asarray(ball.vertices), np.asarray(ball.faces)), encoding="utf-8")
    (home / "surfaces").mkdir()
    found = {}
    for form in formats_of("surface", "scene"):
        if form.holds == "surface" and form.name not in NO_SAMPLE:
            file = home / ("surfaces" if form.mesh_writer else "") / f"ball{form.suffixes[0]}"
            write = (lambda file=file: hg.convert(base, file, force=True)) if form.mesh_writer else None
            if write:
                write()
            found[form.name] = FormatCase(file, sample, lambda form=form, file=file: form.read(file), write)
    return found


def vtp(vertices: NDArray[np.float64], faces: NDArray[np.int64]) -> str:
    """Polygons of VTK as text."""

    def array(about: str, numbers: NDArray[Any]) -> str:
        return f'<DataArray {about} format="ascii">{" ".join(map(str, numbers.ravel().tolist()))}</DataArray>'

    points = array('type="Float32" NumberOfComponents="3"', vertices)
    corners = array('type="Int64" Name="connectivity"', faces)
    ends = array('type="Int64" Name="offsets"', 3 * np.arange(1, len(faces) + 1))
    return (
        '<?xml version="1.0"?><VTKFile type="PolyData" version="1.0" byte_order="LittleEndian"><PolyData>'
        f'<Piece NumberOfPoints="{len(vertices)}" NumberOfPolys="{len(faces)}">'
        f"<Points>{points}</Points><Polys>{corners}{ends}</Polys></Piece></PolyData></VTKFile>"
    )


def scenes(home: Path) -> dict[str, FormatCase]:
    """That ball, a camera and three lamps."""
    scene = home / "scene.toml"
    lamps = "".join(lamp(f"lamp {k}", 0.5 * k, -1.0, 1.0) for k in range(3))
    text = BALL.replace('shape = "sphere"\nscale = 0.15', 'mesh = "ball.ply"\nscale = 0.15')
    scene.write_text(camera((640, 480), 600.0) + lamps + text, encoding="utf-8")
    (home / "scenes").mkdir()
    found, sample = {}, "a mesh of 327,680 triangles, a camera, three lamps ↔ scene.toml"
    for name, out, source in (
        ("glTF", "scene.glb", "scene.glb"),
        ("USD", "scene.usdc", "scene.usdc"),
        ("Mitsuba scene", "scene_for_mitsuba", "scene_for_mitsuba/scene.xml"),
    ):
        file = home / "scenes" / out
        write = lambda file=file: hg.convert(scene, file, force=True)  # noqa: E731
        write()
        found_in = home / "scenes" / source
        again = home / "scenes" / f"{name} again"
        read = lambda file=found_in, again=again: hg.convert(file, again, force=True)  # noqa: E731
        found[name] = FormatCase(file, sample, read, write)
    found["scene, recipe, batch"] = FormatCase(scene, "that scene", lambda: hg.load_scene(scene), None)
    return found


def cameras(home: Path) -> dict[str, FormatCase]:
    """100 of them around a point."""
    turns = np.linspace(0.0, 2.0 * np.pi, VIEWS, endpoint=False)
    lens = hg.Camera(640, 480, (600.0, 600.0), (320.0, 240.0))
    views = {f"{k:03d}.png": lens.look_at((np.cos(t), np.sin(t), 0.5), (0, 0, 0)) for k, t in enumerate(turns)}
    (home / "cameras").mkdir()
    found = {}
    for form in (form for form in formats_of("cameras") if form.key):
        file = home / "cameras" / f"views{form.suffixes[0]}"
        kept = dict(list(views.items())[:1]) if form.key == "opencv" else views
        write = lambda file=file, kept=kept: write_views(file, kept, force=True)  # noqa: E731
        write()
        found[form.name] = FormatCase(
            file, f"{len(kept)} views", lambda form=form, file=file: form.read(file, (640, 480)), write
        )
    return found


def others(home: Path) -> dict[str, FormatCase]:
    """Lamps, spectra, tables, a capture."""
    from hagoromo.files.table import write_table
    from hagoromo.photograph.lamp_files import write_lp

    around = np.linspace(0.0, 6.0, 48)
    lamps = [hg.Lamp(to_lamp=(0.6 * np.cos(t), 0.6 * np.sin(t), 0.8), name=f"{k}.png") for k, t in enumerate(around)]
    waves = np.arange(360.0, 831.0)
    (home / "lamp.spd").write_text("".join(f"{w} {1.0 + 1e-3 * w}\n" for w in waves), encoding="utf-8")
    rows = "".join(f'<SpectralData wavelength="{w}">{1.0 + 1e-3 * w}</SpectralData>' for w in waves)
    (home / "lamp.spdx").write_text(spdx(rows), encoding="utf-8")
    angles = " ".join(str(a) for a in np.linspace(0, 180, 181))
    candela = "\n".join(["100.0"] * 181)
    (home / "lamp.ies").write_text(
        f"IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 181 1 1 2 0 0 0\n1 1 100\n{angles}\n0\n{candela}\n",
        encoding="utf-8",
    )
    (home / "lens.xml").write_text(LENS, encoding="utf-8")
    capture = hg.simulate(home / "small.toml")
    capture.save(home / "capture")
    columns = {"wavelength_nm": waves, **{f"value {k}": waves + k for k in range(20)}}
    by_name = {form.name: form for form in formats()}
    files: dict[str, tuple[str, str, Callable[[], Any] | None]] = {
        "RTI dome .lp": ("dome.lp", "48 lamps", lambda: write_lp(home / "dome.lp", lamps, force=True)),
        "IES LM-63": ("lamp.ies", "181 angles", None),
        "IES TM-27-14": ("lamp.spdx", "471 wavelengths", None),
        "SPD of PBRT and Mitsuba": ("lamp.spd", "471 wavelengths", None),
        "table or spectrum": ("table.csv", "471 × 21", lambda: write_table(home / "table.csv", columns)),
        "capture": ("capture", "a photograph of 256²", lambda: capture.save(home / "capture", force=True)),
        "materials, camera, lamps": ("capture/transforms.json", "of that capture", None),
        "lensfun": ("lens.xml", "one lens", None),
    }
    found = {}
    for name, (file, sample, write) in files.items():
        if write:
            write()
        place = home / file
        found[name] = FormatCase(place, sample, lambda form=by_name[name], place=place: form.read(place), write)
    return found


def spdx(rows: str) -> str:
    """A document of IES TM-27-14."""
    return (
        '<?xml version="1.0" encoding="UTF-8"?><IESTM2714 xmlns="iestm2714" version="1.0"><Header/>'
        "<SpectralDistribution><SpectralQuantity>flux</SpectralQuantity><ReflectionGeometry>other</ReflectionGeometry>"
        "<TransmissionGeometry>other</TransmissionGeometry><BandwidthFWHM>1</BandwidthFWHM>"
        f"<BandwidthCorrected>false</BandwidthCorrected>{rows}</SpectralDistribution></IESTM2714>"
    )


LENS = """<lensdatabase version="1"><mount><name>m</name></mount><lens><maker>M</maker><model>M 50mm</model>
<mount>m</mount><cropfactor>1.5</cropfactor><type>rectilinear</type>
<calibration><distortion model="poly3" focal="50" k1="-0.01"/></calibration></lens></lensdatabase>"""


if __name__ == "__main__":
    main()
