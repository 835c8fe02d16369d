"""The commands that write, each with the smallest inputs, for `fuzz.crash`."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

TO_LAMP = ((0.0, 0.3, 1.0), (0.4, -0.2, 1.0), (-0.3, 0.1, 1.0))
SCENE = """
[camera]
size = [31, 23]
focal = [45.0, 45.0]
response = "canon_eos_300d"
sensor = {exposure = 40000, full_well = 40000, read_noise = 5, gain = 10, bits = 12}
eye = [0.0, -1.0, 0.0]

[[lamp]]
name = "key"
position = [0.5, -2.0, 1.0]
intensity = 3.0

[[surface]]
name = "ball"
shape = "sphere"
scale = 0.15
reflectance = {alpha = 0.2, beta = 0.5, gamma = 0.2, n = 1.5, body_colour = 0.8}
"""
SOLID = """
kind = "solid"
voxel_mm = 1.0
shape = { form = "sphere", radius_mm = 6.0 }
material = { alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 0.8 }
"""
RENDERED = SCENE.split("[[surface]]")[0] + '[[box]]\nrecipe = "solid.toml"\n[render]\nsamples = 1\n'
MORE_LAMPS = """
[[lamp]]
name = "second"
position = [-0.7, -1.5, 0.5]
intensity = 3.0

[[lamp]]
name = "third"
position = [0.0, -1.5, 1.5]
intensity = 3.0

[[lamp]]
name = "fourth"
position = [0.0, -1.5, -1.5]
intensity = 3.0
"""


@dataclass(frozen=True)
class Case:
    """A command. words: its arguments, names of inputs and of the first of `targets` as they lie in the folder.

    folder: whether the targets are folders. forked: whether it may run in a child of a process that has everything
    loaded; kernels may not. resumes: whether its work is kept after a fault.
    """

    name: str
    make: Callable[[Path], None]
    words: tuple[str, ...]
    targets: tuple[str, ...]
    folder: bool = False
    forked: bool = True
    resumes: bool = False

    def given(self, folder: Path) -> list[str]:
        """The arguments, with paths of inputs and output within `folder`."""
        words = [str(folder / word) if (folder / word).exists() else word for word in self.words]
        return [*words, "--out", str(folder / self.targets[0])]


def _cameras(folder: Path) -> None:
    import hagoromo as hg

    lens = hg.Camera(40, 30, (50.0, 50.0), (20.0, 15.0))
    turned = np.eye(4)
    turned[:3, 3] = 0.1, 0.2, 2.0
    hg.write_views(folder / "cameras.yml", {"a.png": lens.with_pose(turned), "b.png": lens.with_pose(np.eye(4))})


def _photographs(folder: Path) -> None:
    from hagoromo.files.exr import write_exr
    from hagoromo.files.record import write_json

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
    weights = np.random.default_rng(5).uniform(0.0, 1.0, (9, 13, 2)).astype(np.float32)
    palette = hg.Palette((body,), (body,), (lamp,), ("key",), (0,))
    hg.Image(weights, np.ones((9, 13), np.float32), palette).save(folder / "scene.exr")
    (folder / "scene.png").unlink()


def _scene(folder: Path) -> None:
    (folder / "scene.toml").write_text(SCENE)


def _recipe(folder: Path) -> None:
    (folder / "solid.toml").write_text(SOLID)


def _box_scene(folder: Path) -> None:
    _recipe(folder)
    (folder / "scene.toml").write_text(RENDERED)


def _capture(folder: Path) -> None:
    import subprocess
    import sys

    (folder / "scene.toml").write_text(SCENE + MORE_LAMPS)
    call = [sys.executable, "-m", "hagoromo", "simulate", str(folder / "scene.toml"), "--out", str(folder / "capture")]
    subprocess.run(call, check=True, stdout=subprocess.DEVNULL)
    (folder / "scene.toml").unlink()


CASES = (
    Case("convert to OpenCV", _cameras, ("convert", "cameras.yml"), ("out.yml",)),
    Case("convert to COLMAP", _cameras, ("convert", "cameras.yml"), ("out",), folder=True),
    Case("convert to nerfstudio", _cameras, ("convert", "cameras.yml"), ("out.json",)),
    Case("convert to Middlebury", _cameras, ("convert", "cameras.yml"), ("out.txt",)),
    Case("expose", _image, ("expose", "scene.exr"), ("out.exr", "out.png")),
    Case("develop", _exposure, ("develop", "a.png", "--exposures", "0.1", "--black", "512"), ("out.exr",)),
    Case(
        "capture", _photographs, ("capture", "a.exr", "b.exr", "c.exr", "--lamps", "lamps.json"), ("out",),
        folder=True,
    ),
    Case(
        "calibrate response", _pairs, ("calibrate", "response", "pairs.csv"),
        ("out.csv", "out_interval.csv", "out.png"),
    ),
    Case(
        "calibrate camera", _boards,
        ("calibrate", "camera", "0.png", "1.png", "2.png", "3.png", "--board", "7x5", "--square", "0.02"),
        ("out.json", "out.png"), forked=False,
    ),
    Case("simulate", _scene, ("simulate", "scene.toml"), ("out",), folder=True, forked=False),
    Case("measure", _capture, ("measure", "capture"), ("out",), folder=True, forked=False),
    Case(
        "build", _recipe, ("build", "solid.toml"), ("out.zarr",), folder=True, forked=False, resumes=True
    ),
    Case("render", _box_scene, ("render", "scene.toml"), ("out.exr", "out.png"), forked=False),
)  # fmt: skip
