"""Scenes, recipes, captures and boxes to spoil, and the law of bad input: one line on standard error, status 2."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from dask import config

from hagoromo.app.cli import main
from hagoromo.cluster.cluster import workers_of
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import write_json
from hagoromo.files.table import write_table
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import save_box
from tests.app.in_browser import CHROMIUM, FLAGS, started
from tests.ball_scene import ball_scene

SCENE = ball_scene()


RECIPE = """
kind = "skin"
size_mm = 6.0
[material]
alpha = 0.2
beta = 0.5
gamma = 0.2
n = 1.4
body_colour = 0.7
"""


@pytest.fixture(scope="session")
def cluster():
    """Two worker processes of this machine, for all tests of one session."""
    with workers_of(2) as two:
        yield two


@pytest.fixture
def address(cluster):
    """The address of their scheduler, with its certificates in Dask's settings, as somebody's own ones would be."""
    security, names = cluster.client.security, ("client.cert", "client.key")
    known = {f"distributed.comm.tls.{name}": getattr(security, f"tls_{name.replace('.', '_')}") for name in names}
    with config.set(known | {"distributed.comm.tls.ca-file": security.tls_ca_file}):
        yield cluster.client.scheduler.address


@pytest.fixture(scope="module")
def browser():
    """Chromium without a window, drawing in software."""
    with started() as running:
        chromium = running.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        yield chromium
        chromium.close()


@pytest.fixture
def scene(tmp_path):
    """Writes a scene file: the one above with `old` replaced by `new` and `more` at its end."""

    def write(old: str = "", new: str = "", more: str = "") -> Path:
        assert old in SCENE
        (tmp_path / "scene.toml").write_text(SCENE.replace(old, new, 1) + more if old else SCENE + more)
        return tmp_path / "scene.toml"

    return write


@pytest.fixture
def recipe():
    """The text of a recipe."""
    return RECIPE


@pytest.fixture(scope="module")
def photographed(tmp_path_factory):
    """A capture of the scene above."""
    folder = tmp_path_factory.mktemp("photographed")
    (folder / "scene.toml").write_text(SCENE)
    assert main(["simulate", str(folder / "scene.toml"), "--out", str(folder / "capture")]) == 0
    return folder / "capture"


@pytest.fixture
def capture(photographed, tmp_path):
    """A copy of the capture, to spoil."""
    return Path(shutil.copytree(photographed, tmp_path / "capture"))


@pytest.fixture
def box(tmp_path):
    """A volume box on disk, to spoil."""
    density = np.ones((11, 5, 7), np.float32)
    axis = np.broadcast_to(np.array([0, 0, 1], np.float32), (*density.shape, 3))
    matter = Reflectance(0.2, 0.5, 0.2, 1.5, Spectrum.constant(0.8))
    save_box(VolumeBox.from_arrays(density, axis, 0.01, 100.0, [matter], name="slab"), tmp_path / "slab.zarr")
    return tmp_path / "slab.zarr"


@pytest.fixture
def refused(capsys, tmp_path):
    """Run a verb that must be refused; gives the line it said."""

    def run(*arguments) -> str:
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        status = main([str(argument) for argument in arguments])
        said = capsys.readouterr()
        print(said.err)
        assert status == 2
        assert said.out == "" and said.err.count("\n") == 1 and said.err.startswith("hagoromo: ")
        assert sorted(tmp_path.rglob("*")) == before
        return said.err

    return run


@pytest.fixture
def whole_file_of(tmp_path):
    """A valid file of each kind that is read."""

    def write(kind: str) -> Path:
        path = tmp_path / f"a.{kind}"
        image = np.random.default_rng(1).integers(0, 255, (31, 37, 3), dtype=np.uint8)
        if kind == "exr":
            write_exr(path, {"R": image[..., 0], "G": image[..., 1]})
        elif kind == "png":
            write_png(path, image)
        elif kind == "jpg":
            import cv2

            path.write_bytes(cv2.imencode(".jpg", image)[1].tobytes())
        elif kind == "csv":
            write_table(path, {"wavelength_nm": [400, 500, 600], "value": [1, 2, 3]})
        elif kind == "json":
            write_json(path, {"lamps": [{"to_lamp": [0, 0, 1], "intensity": 1.0}]})
        elif kind == "toml":
            path.write_text(SCENE)
        return path

    return write
