"""The commands that write, each with the smallest inputs, for `fuzz.crash`."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np

from hagoromo.files.record import read_json, write_json
from tests.ball_scene import KEY, ball_scene, camera, lamp

TO_LAMP = ((0.0, 0.3, 1.0), (0.4, -0.2, 1.0), (-0.3, 0.1, 1.0))
SIZE, FOCAL = (31, 23), 45.0  # px
SECOND, THIRD = lamp("second", -0.7, -1.5, 0.5), lamp("third", 0.0, -1.5, 1.5)
LAMPS = (KEY, SECOND, THIRD, lamp("fourth", 0.0, -1.5, -1.5))
SOLID = """
kind = "solid"
voxel_mm = 1.0
shape = { form = "sphere", radius_mm = 6.0 }
material = { alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 0.8 }
"""
CLOTH = """
kind = "cloth"
width_mm = 3.0
height_mm = 3.0
voxel_mm = 0.2
carrier_mm = 2.0
variants = 1
material = { alpha = 0.2, beta = 0.5, gamma = 0.2, n = 1.4, body_colour = 0.7 }
"""
RENDERED = camera(SIZE, FOCAL) + KEY + '\n[[box]]\nrecipe = "solid.toml"\n[render]\nsamples = 1\n'
BATCH = """
each = "cameras/*.yml"

[[step]]
name = "model"
verb = "convert"
arguments = ["{path}"]
options = { to = "colmap" }
out = "models/{name}"

[[step]]
name = "yaml"
verb = "convert"
arguments = ["{model}"]
out = "yaml/{name}.yml"
"""


@dataclass(frozen=True)
class CrashCase:
    """A command. words: its arguments, names of inputs and of the first of `targets` as they lie in the folder.

    A target without suffix, or with .zarr, is a folder. out: the argument of --out, if it is not the first target.
    apart: the targets do not belong together, each is old or new, whatever the others are. resumes: whether its work is
    kept after a fault. grows: the first target has a report.html early, whole, and gets more files. forces: whether it
    has --force; what has not always replaces. fails: exit statuses for a full disk. slow: so many times fewer points
    are tried. prepare: called once in the process that runs it.
    """

    name: str
    make: Callable[[Path], None]
    words: tuple[str, ...]
    targets: tuple[str, ...]
    out: str = ""
    apart: bool = False
    resumes: bool = False
    grows: bool = False
    forces: bool = True
    fails: tuple[int, ...] = (2,)
    slow: int = 1
    prepare: Callable[[], None] | None = None

    def given(self, folder: Path) -> list[str]:
        """The arguments, with paths of inputs and output within `folder`."""
        words = [str(folder / word) if (folder / word).exists() else word for word in self.words]
        return [*words, "--out", str(folder / (self.out or self.targets[0]))]


def _cameras(folder: Path) -> None:
    import hagoromo as hg

    lens = hg.Camera(40, 30, (50.0, 50.0), (20.0, 15.0))
    turned = np.eye(4)
    turned[:3, 3] = 0.1, 0.2, 2.0
    hg.write_views(folder / "cameras.yml", {"a.png": lens.with_pose(turned), "b.png": lens.with_pose(np.eye(4))})


def _volume(folder: Path) -> None:
    density = np.zeros((9, 9, 9), np.float32)
    density[2:7, 2:7, 2:7] = 1.0
    np.save(folder / "a.npy", density)


def _gltf(folder: Path) -> None:
    from fuzz.meshes import glb

    glb(folder / "a.glb")


def _usd(folder: Path) -> None:
    from fuzz.usd_scenes import scene

    scene(folder / "a.usda")


def _plain_scene(folder: Path) -> None:
    (folder / "scene.toml").write_text(ball_scene(SIZE, FOCAL, [KEY]))


def _mitsuba(folder: Path) -> None:
    from fuzz.mitsuba_scenes import scene

    scene(folder)


def _small_box(folder: Path) -> None:
    from fuzz.boxes import box

    box(folder / "box.zarr")


def _photographs(folder: Path) -> None:
    from hagoromo.files.exr import write_exr

    random = np.random.default_rng(2)
    for name in "abc":
        values = random.uniform(0.1, 0.9, (7, 11, 3)).astype(np.float32)
        write_exr(folder / f"{name}.exr", {key: values[..., k] for k, key in enumerate("RGB")})
    lamps = [{"name": f"{n}.png", "to_lamp": list(to)} for n, to in zip("cab", TO_LAMP, strict=True)]
    write_json(folder / "lamps.json", {"lamps": lamps})


def _exposure(folder: Path) -> None:
    from hagoromo.files.png import write_png

    numbers = np.random.default_rng(3).integers(1000, 50_000, (16, 24), dtype=np.uint16)
    write_png(folder / "a.png", numbers)


def _pairs(folder: Path) -> None:
    import hagoromo as hg
    from hagoromo.files.table import write_table

    wavelengths = np.arange(400, 701, 20)
    random = np.random.default_rng(4)
    spectra = random.uniform(0.0, 1.0, (30, len(wavelengths)))
    curves = np.stack([np.exp(-0.5 * ((wavelengths - at) / 40.0) ** 2) for at in (600, 540, 460)])
    readings = spectra @ curves.T
    columns = {f"{w}": spectra[:, k] for k, w in enumerate(wavelengths)}
    write_table(folder / "pairs.csv", columns | {name: readings[:, k] for k, name in enumerate("RGB")})
    assert hg


def _boards(folder: Path) -> None:
    from hagoromo.files.png import write_png
    from tests.inverse.test_calibrate_camera import BOARD, TRUE, photographs_of

    for name, picture in list(photographs_of(TRUE, BOARD).items())[:4]:
        write_png(folder / f"{name}.png", picture)


def _image(folder: Path) -> None:
    import hagoromo as hg

    body, lamp = hg.Spectrum.constant(0.8), hg.Spectrum.constant(1.0)
    weights = np.random.default_rng(5).uniform(0.0, 1.0, (12, 13, 2)).astype(np.float32)
    palette = hg.Palette((body,), (body,), (lamp,), ("key",), (0,))
    hg.Image(weights, np.ones((12, 13), np.float32), palette).save(folder / "scene.exr")
    (folder / "scene.png").unlink()


def _scene(folder: Path) -> None:
    (folder / "scene.toml").write_text(ball_scene(SIZE, FOCAL, [KEY]))


def _recipe(folder: Path) -> None:
    (folder / "solid.toml").write_text(SOLID)


def _cloth(folder: Path) -> None:
    (folder / "cloth.toml").write_text(CLOTH)


def _box_scene(folder: Path) -> None:
    _recipe(folder)
    (folder / "scene.toml").write_text(RENDERED)


def _capture(folder: Path) -> None:
    _photographed(folder, ball_scene(SIZE, FOCAL, LAMPS))


def _unknown_shape(folder: Path) -> None:
    """As the tutorial's: far lamps, the camera at the origin, and a shape that is not stated."""
    lamps = [f"[[lamp]]\nto_lamp = [{0.6 * np.cos(a)}, -1.0, {0.6 * np.sin(a)}]\n" for a in np.arange(5) * 1.2]
    _photographed(folder, ball_scene((23, 19), FOCAL, lamps))
    record = read_json(folder / "capture" / "transforms.json")
    for key in ("points_path", "normals_path"):
        record.pop(key)
    write_json(folder / "capture" / "transforms.json", record)


def _all_around(folder: Path) -> None:
    """A ball from five sides, under a lamp beside each camera."""
    import hagoromo as hg

    rows, columns = np.mgrid[:16, :16] - 7.5
    disc, photographs = np.hypot(rows, columns) < 5.0, []
    for eye in ((0.0, -1.0, 0.1), (1.0, 0.0, -0.1), (0.0, 1.0, 0.2), (-1.0, 0.0, 0.0), (0.6, -0.6, 0.5)):
        camera = hg.Camera(16, 16, (60.0, 60.0), (8.0, 8.0)).look_at(eye, (0.0, 0.0, 0.0))
        values = np.where(disc[..., None], 0.3, 0.0).repeat(3, axis=2).astype(np.float32)
        lamp = hg.Lamp(position=(eye[0], eye[1], eye[2] + 0.3))
        photographs.append(hg.Photograph(values, 1e-4 + 0.0 * values, disc, camera, (lamp,), f"{eye}", silhouette=disc))
    hg.Capture(tuple(photographs), "ball").save(folder / "capture")


def _card(folder: Path) -> None:
    """A flat card under far lamps."""
    import hagoromo as hg

    camera = hg.Camera(24, 16, (1e4, 1e4), (12.0, 8.0)).look_at((0.0, 0.0, 5.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    values, photographs = np.full((16, 24, 3), 0.4, np.float32), []
    for to in TO_LAMP:
        lamp = hg.Lamp(to_lamp=to)
        photographs.append(hg.Photograph(values, 1e-6 * values, np.ones((16, 24), bool), camera, (lamp,), f"{to}"))
    hg.save_capture(hg.Capture(tuple(photographs), "card"), folder / "capture")


def _photographed(folder: Path, scene: str) -> None:
    import hagoromo as hg

    (folder / "scene.toml").write_text(scene)
    hg.simulate(folder / "scene.toml", name="capture").save(folder / "capture")
    (folder / "scene.toml").unlink()


def _measured(folder: Path) -> None:
    import hagoromo as hg

    _photographed(folder, ball_scene(SIZE, FOCAL, LAMPS))
    hg.measure(folder / "capture").save(folder / "measured")
    shutil.rmtree(folder / "capture")


def _two_dates(folder: Path) -> None:
    from tests.inverse.simulated_relief import SimulatedRelief, relief_camera, relief_measurement

    for seed, name in enumerate(("before", "after")):
        relief_measurement(SimulatedRelief(), relief_camera(40, eye=(0.02 * seed, 0.0, 0.4)), seed).save(folder / name)


def _results(folder: Path) -> None:
    (folder / "results").mkdir()
    write_json(folder / "results" / "materials.json", [{"hagoromo": {"version": "0", "settings": {"n": 1.5}}}])
    (folder / "profile.toml").write_text('creator = "A"\ninstitution = "M"\nlicence = "CC0-1.0"\n')


def _balls(folder: Path) -> None:
    from hagoromo.files.png import write_png
    from tests.inverse.simulated_mirror import mask_of, mirror_photograph, seen_from_afar

    ball = seen_from_afar((45, 47), (23.4, 22.3), 17.2)
    write_png(folder / "mask.png", mask_of(ball))
    for k in range(2):
        write_png(folder / f"{k}.png", mirror_photograph([ball], (0.3, 0.4 * k, 0.87), k, 0.1))


def _views(folder: Path) -> None:
    from fuzz.records import views

    views(folder, "nerfstudio", "transforms.json")
    (folder / "images").mkdir()
    for name in "ab":
        (folder / "images" / f"{name}.png").write_bytes((folder / "a.png").read_bytes())
    (folder / "a.png").unlink()


def _batch(folder: Path) -> None:
    (folder / "cameras").mkdir()
    for name in "ab":
        _cameras(folder / "cameras")
        (folder / "cameras" / "cameras.yml").rename(folder / "cameras" / f"{name}.yml")
    (folder / "batch.toml").write_text(BATCH)


def _nothing(folder: Path) -> None:
    pass


def _smaller_demo() -> None:
    """The demo in the size of its tests, with a clock that stands still: it writes how long its stages took."""
    from types import SimpleNamespace

    from hagoromo_matter.demo import demo

    demo.SIZES["small"] = demo.SIZES["tiny"]
    demo.__dict__["time"] = SimpleNamespace(perf_counter=lambda: 0.0)


def _schemas() -> tuple[str, ...]:
    from hagoromo.app.schemas import schema_names

    return tuple(f"out/{name}.json" for name in schema_names())


USD_CASES = (
    CrashCase("convert USD to a scene", _usd, ("convert", "a.usda"), ("out",), slow=8),
    CrashCase("convert a scene to USD", _plain_scene, ("convert", "scene.toml"), ("out.usdc",), slow=4),
)
CASES = (
    CrashCase("convert to OpenCV", _cameras, ("convert", "cameras.yml"), ("out.yml",)),
    CrashCase("convert to COLMAP", _cameras, ("convert", "cameras.yml"), ("out",)),
    CrashCase("convert to nerfstudio", _cameras, ("convert", "cameras.yml"), ("out.json",)),
    CrashCase("convert to Middlebury", _cameras, ("convert", "cameras.yml"), ("out.txt",)),
    CrashCase(
        "convert to a capture", _views, ("convert", "transforms.json", "--images", "images"), ("out",)
    ),
    CrashCase("convert to a box", _volume, ("convert", "a.npy"), ("out.zarr",), resumes=True),
    CrashCase("convert to NRRD", _small_box, ("convert", "box.zarr"), ("out.nrrd",)),
    CrashCase("convert to OpenVDB", _small_box, ("convert", "box.zarr"), ("out.vdb",)),
    CrashCase("convert to VTI", _small_box, ("convert", "box.zarr"), ("out.vti",)),
    CrashCase("convert to .vol", _small_box, ("convert", "box.zarr"), ("out.vol",)),
    CrashCase("convert to HDR", _image, ("convert", "scene.exr"), ("out.hdr",)),
    CrashCase("convert to TIFF", _image, ("convert", "scene.exr"), ("out.tif",)),
    CrashCase(
        "convert to tiles and parts", _image, ("convert", "scene.exr", "--exr", "half", "tiles", "parts"), ("out.exr",)
    ),
    CrashCase("convert to spectra", _image, ("convert", "scene.exr", "--to", "spectral"), ("out.exr",)),
    CrashCase("convert a scene to glTF", _scene, ("convert", "scene.toml"), ("out.glb",)),
    CrashCase("convert a scene for Mitsuba", _scene, ("convert", "scene.toml"), ("out",)),
    CrashCase("convert a scene of Mitsuba", _mitsuba, ("convert", "a.xml"), ("out",)),
    *(USD_CASES if find_spec("pxr") else ()),  # an extra
    CrashCase("convert glTF to OBJ", _gltf, ("convert", "a.glb"), ("out.obj",)),
    CrashCase("convert glTF to a scene", _gltf, ("convert", "a.glb"), ("out",)),
    CrashCase("expose", _image, ("expose", "scene.exr"), ("out.exr", "out.png")),
    CrashCase("develop", _exposure, ("develop", "a.png", "--exposures", "0.1", "--black", "512"), ("out.exr",)),
    CrashCase(
        "capture", _photographs, ("capture", "a.exr", "b.exr", "c.exr", "--lamps", "lamps.json"), ("out",)
    ),
    CrashCase(
        "calibrate response", _pairs, ("calibrate", "response", "pairs.csv"),
        ("out.csv", "out_interval.csv", "out.json", "out.png"),
    ),
    CrashCase(
        "calibrate camera", _boards,
        ("calibrate", "camera", "0.png", "1.png", "2.png", "3.png", "--board", "7x5", "--square", "0.02"),
        ("out.json", "out.png"),
    ),
    CrashCase("calibrate lamps", _balls, ("calibrate", "lamps", "0.png", "1.png", "--mask", "mask.png"), ("out.json",)),
    CrashCase("calibrate rig", _card, ("calibrate", "rig", "capture", "--card"), ("out.json",)),
    CrashCase("simulate", _scene, ("simulate", "scene.toml"), ("out",)),
    CrashCase("measure", _capture, ("measure", "capture"), ("out",)),
    CrashCase("measure unknown shape", _unknown_shape, ("measure", "capture"), ("out",), slow=3),
    CrashCase("health", _unknown_shape, ("health", "capture"), ("out.json",)),
    CrashCase("build", _recipe, ("build", "solid.toml"), ("out.zarr",), resumes=True),
    CrashCase("build a texel", _cloth, ("build", "cloth.toml"), ("out.zarr",), resumes=True, slow=5),
    CrashCase("render", _box_scene, ("render", "scene.toml"), ("out.exr", "out.png")),
    CrashCase("render frames", _scene, ("render", "scene.toml", "--turntable", "2"), ("out",), resumes=True),
    CrashCase(
        "render a film", _scene, ("render", "scene.toml", "--turntable", "2"), ("out.gif", "out_frames"), apart=True
    ),
    CrashCase("render by walks", _scene, ("render", "scene.toml", "--mode", "path"), ("out.exr", "out.png")),
    CrashCase("relight", _capture, ("relight", "capture"), ("out",), slow=6),
    CrashCase(
        "recover", _all_around, ("recover", "capture", "--side", "16", "--steps", "1", "--voxels", "16"),
        ("out.zarr", "out.ply", "out.json", "out.html"), apart=True, slow=6,
    ),
    CrashCase(
        "spectra", _photographs,
        ("spectra", "a.exr", "--lamp", "D65", "--response", "canon_eos_300d", "--white", "w", "--region", "w=0,0,4,4",
         "--region", "r=5,0,4,4", "--prior", "smooth"),
        ("out",),
    ),
    CrashCase("publish a page", _measured, ("publish", "measured"), ("out.html",)),
    CrashCase("publish a box", _box_scene, ("publish", "scene.toml", "--lamps", "8"), ("out.html",), slow=4),
    CrashCase("publish a folder", _measured, ("publish", "measured"), ("out",)),
    CrashCase("profile", _measured, ("profile", "measured", "--line", "12", "11", "19", "12"), ("out.csv", "out.png")),
    CrashCase("maps", _measured, ("maps", "measured"), ("out",)),
    CrashCase("raking", _measured, ("raking", "measured", "--frames", "2"), ("out",)),
    CrashCase("change", _two_dates, ("change", "before", "after"), ("out",), slow=6),
    CrashCase("archive", _results, ("archive", "results", "--profile", "profile.toml", "--inventory", "1"), ("out",)),
    CrashCase("export", _measured, ("export", "measured", "--to", "png", "ply", "ptm"), ("out",)),
    CrashCase("schema", _nothing, ("schema",), _schemas(), out="out", apart=True, forces=False),
    CrashCase(
        "batch", _batch, ("batch", "batch.toml"), ("out/models/a", "out/models/b", "out/yaml/a.yml", "out/yaml/b.yml"),
        out="out", apart=True, fails=(1, 2),
    ),
    CrashCase("demo", _nothing, ("demo",), ("out",), grows=True, slow=15, prepare=_smaller_demo),
)  # fmt: skip
