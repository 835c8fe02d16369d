"""Bad input ends with one line on standard error, status 2 and nothing half-written: each kind of it has a test."""

import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import read_json, write_json
from hagoromo.files.table import write_table
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store import save_box

SCENE = """
[camera]
size = [61, 47]
focal = [90.0, 90.0]
response = "canon_eos_300d"
sensor = {exposure = 40000, full_well = 40000, read_noise = 5, gain = 10, bits = 12}
eye = [0.0, -1.0, 0.0]

[[lamp]]
name = "key"
position = [0.5, -2.0, 1.0]
intensity = 3.0

[[lamp]]
name = "fill"
position = [-0.7, -1.5, 0.5]
intensity = 3.0

[[surface]]
name = "ball"
shape = "sphere"
scale = 0.15
reflectance = {alpha = 0.2, beta = 0.5, gamma = 0.2, n = 1.5, body_colour = 0.8}
"""


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


@pytest.fixture
def scene(tmp_path):
    """Writes a scene file: the one above with `old` replaced by `new` and `more` at its end."""

    def write(old: str = "", new: str = "", more: str = "") -> Path:
        assert old in SCENE
        (tmp_path / "scene.toml").write_text(SCENE.replace(old, new, 1) + more if old else SCENE + more)
        return tmp_path / "scene.toml"

    return write


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


def whole_file_of(kind: str, folder):
    """A valid file of each kind that is read."""
    path = folder / f"a.{kind}"
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


KINDS = ("exr", "png", "jpg", "csv", "json", "toml")


@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_file_is_named(refused, tmp_path, kind):
    assert f"a.{kind} does not exist" in refused("info", tmp_path / f"a.{kind}")


@pytest.mark.parametrize("kind", KINDS)
def test_a_truncated_file_is_refused(refused, tmp_path, kind):
    """Cut in the middle, for text in the middle of a value: a table that ends with a whole row cannot be told."""
    path = whole_file_of(kind, tmp_path)
    assert main(["info", str(path)]) == 0
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(b",")] if kind == "csv" else data[: len(data) // 2])
    assert str(path) in refused("info", path)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_another_kind_is_refused(refused, tmp_path, kind):
    path = tmp_path / f"a.{kind}"
    path.write_bytes(np.random.default_rng(2).bytes(4099))
    assert str(path) in refused("info", path)


def test_a_folder_of_no_known_kind_is_refused(refused, tmp_path):
    assert "neither a capture" in refused("info", tmp_path)


def test_wrong_use_is_one_line(refused):
    assert "Unrecognized options: nonsense" in refused("nonsense")
    assert "--out" in refused("calibrate", "response", "pairs.csv")
    said = refused("calibrate", "camera", "--board", "9x6", "--square", "wide", "--out", "a.json")
    assert said.startswith("hagoromo: Error parsing --square: could not convert string to float: 'wide'; Argument")


def test_photographs_of_different_sizes_are_refused(refused, tmp_path):
    for name, height in (("a", 31), ("b", 37)):
        write_png(tmp_path / f"{name}.png", np.zeros((height, 41), np.uint8))
    said = refused(
        *("calibrate", "camera", tmp_path / "a.png", tmp_path / "b.png"),
        *("--board", "9x6", "--square", "0.025", "--out", tmp_path / "camera.json"),
    )
    assert "different sizes" in said and "41x31" in said and "41x37" in said


def test_an_existing_output_is_refused_without_force(refused, tmp_path):
    (tmp_path / "camera.json").write_text("mine")
    write_png(tmp_path / "a.png", np.zeros((31, 41), np.uint8))
    said = refused(
        *("calibrate", "camera", tmp_path / "a.png", "--board", "9x6", "--square", "0.025"),
        *("--out", tmp_path / "camera.json"),
    )
    assert "exists" in said and "--force" in said
    assert (tmp_path / "camera.json").read_text() == "mine"


def test_an_interrupt_leaves_nothing_behind(tmp_path, monkeypatch, capsys):
    whole_file_of("png", tmp_path)
    before = sorted(tmp_path.rglob("*"))

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr("hagoromo.camera.board.Board.find", interrupted)
    arguments = ["calibrate", "camera", str(tmp_path / "a.png"), "--board", "9x6", "--square", "0.025"]
    assert main([*arguments, "--out", str(tmp_path / "new" / "camera.json")]) == 130
    assert capsys.readouterr().err == "hagoromo: interrupted: nothing was written\n"
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == before


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM])
def test_an_interrupt_of_a_long_verb_leaves_nothing_behind(tmp_path, scene, number):
    """Ctrl-C (or a polite kill) half a second after the rendering's temporary file appears, in a process of its own."""
    slow = scene("size = [61, 47]", "size = [610, 470]", "[render]\nsamples = 4000\n")
    before = sorted(tmp_path.rglob("*"))
    code = "import sys; from hagoromo.app.cli import main; sys.exit(main(sys.argv[1:]))"
    command = [sys.executable, "-c", code, "simulate", str(slow), "--out", str(tmp_path / "capture")]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
    for _ in range(600):
        if sorted(tmp_path.rglob("*")) != before or process.poll() is not None:
            break
        time.sleep(0.05)
    time.sleep(0.5)
    process.send_signal(number)
    _, said = process.communicate(timeout=60)
    assert (process.returncode, said) == (130, "hagoromo: interrupted: nothing was written\n")
    assert sorted(tmp_path.rglob("*")) == before


def test_unknown_keys_are_named_with_the_known_ones(refused, scene, tmp_path):
    for old, new in (("intensity = 3.0", "intensty = 3.0"), ("eye =", "zoom = 2\neye =")):
        said = refused("render", scene(old, new), "--out", tmp_path / "a.exr")
        assert "unknown key" in said and "known are" in said and "scene.toml" in said


def test_a_tolerance_beyond_reason_is_refused(refused, scene, tmp_path):
    assert "tolerance is 7" in refused("render", scene(), "--out", tmp_path / "a.exr", "--tolerance", 7)


def test_a_reflectance_that_breaks_energy_conservation_is_refused(refused, scene, tmp_path):
    assert "energy conservation" in refused("render", scene("alpha = 0.2", "alpha = 0.9"), "--out", tmp_path / "a.exr")


def test_a_camera_that_looks_at_nothing_is_refused(refused, scene, tmp_path):
    away = scene("eye = [0.0, -1.0, 0.0]", "eye = [0.0, -1.0, 0.0]\ntarget = [0.0, -2.0, 0.0]")
    assert "looks at nothing" in refused("render", away, "--out", tmp_path / "a.exr")


def test_a_lamp_inside_a_box_is_refused(refused, scene, box, tmp_path):
    inside = scene(more='[[box]]\nfile = "slab.zarr"\nposition = [0.47, -2.02, 0.95]\n')
    assert "lamp key stands inside the volume box 'slab'" in refused("render", inside, "--out", tmp_path / "a.exr")


@pytest.mark.parametrize("value", [np.nan, -1.0, np.inf])
def test_a_density_that_is_none_is_refused(refused, scene, box, tmp_path, value):
    import zarr

    density: Any = zarr.open_group(box)["density"]
    density[3, 2, 1] = value
    seen = scene(more='[[box]]\nfile = "slab.zarr"\n')
    assert "density" in refused("render", seen, "--out", tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("key", "value"), [("voxel_size", 0.0), ("voxel_size", "NaN"), ("tau", -1.0), ("pose", [0.0] * 16), ("tau", None)]
)
def test_a_lattice_of_no_size_is_refused(refused, box, key, value):
    record = json.loads((box / "zarr.json").read_text())
    record["attributes"]["hagoromo"][key] = value
    (box / "zarr.json").write_text(json.dumps(record))
    assert key in refused("info", box)


@pytest.mark.parametrize(("shape", "said"), [([0, 5, 7], "0"), ([1 << 18, 1 << 18, 1 << 18], "GiB of memory")])
def test_a_lattice_that_is_empty_or_does_not_fit_memory_is_refused_before_allocation(refused, box, shape, said):
    for name, more in (("density", []), ("axis", [3])):
        record = json.loads((box / name / "zarr.json").read_text())
        record["shape"] = [*shape, *more]
        (box / name / "zarr.json").write_text(json.dumps(record))
    start = time.perf_counter()
    assert said in refused("info", box)
    assert time.perf_counter() - start < 5.0  # s; reading it would take hours


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("size_mm = 6.0", "size_mm = 0.0", "above 0"),
        ("size_mm = 6.0", "size_mm = nan", "finite"),
        ("size_mm = 6.0", "size_mm = 1e6", "too fine"),
        ("size_mm = 6.0", "size_m = 6.0", "unknown key 'size_m'"),
        ("beta = 0.5", "beta = -0.5", "beta"),
        ("alpha = 0.2", "alpha = 0.9", "energy conservation"),
        ('kind = "skin"', 'kind = "scales"', "one of skin"),
        ("[material]", "[materials]", "material"),
        ("body_colour = 0.7", 'body_colour = "../red.csv"', "leads out"),
    ],
)
def test_a_bad_recipe_is_refused(refused, tmp_path, old, new, said):
    assert old in RECIPE
    (tmp_path / "matter.toml").write_text(RECIPE.replace(old, new))
    assert said in refused("build", tmp_path / "matter.toml", "--out", tmp_path / "matter.zarr")


@pytest.mark.parametrize("name", ["zarr.json", "density/zarr.json", "bricks/c/0/0/0"])
def test_a_damaged_box_is_refused(refused, box, name):
    path = box / name
    path.write_bytes(path.read_bytes()[:5])
    refused("info", box)


def test_an_image_that_does_not_fit_memory_is_refused_before_allocation(refused, scene, tmp_path):
    vast = scene("size = [61, 47]", "size = [4000000, 3000000]")
    assert "GiB of memory" in refused("render", vast, "--out", tmp_path / "a.exr")


def with_images(capture: Path, *images: np.ndarray, **frame) -> Path:
    """The capture with other images, and `frame` in each of its frames."""
    record = read_json(capture / "transforms.json")
    for k, image in enumerate(images):
        write_png(capture / f"{k}.png", image)
        record["frames"][k] |= {"file_path": f"{k}.png", **frame}
    write_json(capture / "transforms.json", record)
    return capture


def test_photographs_of_different_sizes_in_a_capture_are_refused(refused, capture, tmp_path):
    with_images(capture, *(np.full((height, 61, 3), 900, np.uint16) for height in (47, 43)))
    assert "1.png" in refused("measure", capture, "--out", tmp_path / "measured")


def test_photographs_that_are_all_saturated_are_refused(refused, capture, tmp_path):
    with_images(capture, *[np.full((47, 61, 3), 4095, np.uint16)] * 2)
    refused("measure", capture, "--out", tmp_path / "measured")


def test_photographs_that_are_all_masked_are_refused(refused, capture, tmp_path):
    write_png(capture / "mask.png", np.zeros((47, 61), np.uint8))
    with_images(capture, *[np.full((47, 61, 3), 900, np.uint16)] * 2, mask_path="mask.png")
    refused("measure", capture, "--out", tmp_path / "measured")


@pytest.mark.parametrize("name", ["transforms.json", "normals.exr", "images"])
def test_a_capture_with_a_missing_part_is_refused(refused, capture, tmp_path, name):
    path = capture / name
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    refused("measure", capture, "--out", tmp_path / "measured")


@pytest.mark.parametrize("name", ["transforms.json", "normals.exr", "canon_eos_300d.csv"])
def test_a_capture_with_a_truncated_part_is_refused(refused, capture, tmp_path, name):
    data = (capture / name).read_bytes()
    (capture / name).write_bytes(data[: len(data) // 2 - 3])
    refused("measure", capture, "--out", tmp_path / "measured")


def test_a_capture_that_reaches_out_of_its_folder_is_refused(refused, capture, tmp_path):
    record = read_json(capture / "transforms.json")
    record["frames"][0]["file_path"] = "../../secret.png"
    write_json(capture / "transforms.json", record)
    assert "leads out" in refused("measure", capture, "--out", tmp_path / "measured")


def test_every_verb_refuses_an_existing_output_before_its_work(refused, scene, capture, tmp_path):
    (tmp_path / "skin.toml").write_text(RECIPE)
    for verb, given, out in (
        ("build", tmp_path / "skin.toml", "skin.zarr"),
        ("demo", None, "demo"),
        ("render", scene(), "a.exr"),
        ("simulate", scene(), "photographs"),
        ("measure", capture, "measured"),
    ):
        path = tmp_path / out
        if path.suffix == ".exr":
            path.write_text("mine")
        else:
            path.mkdir()
            (path / "mine").touch()
        start = time.perf_counter()
        assert "--force" in refused(verb, *([given] if given else []), "--out", path)
        assert time.perf_counter() - start < 2.0  # s; the work itself takes longer
    assert os.listdir(tmp_path / "measured") == ["mine"]


def test_images_that_cannot_be_compared_are_refused(refused, tmp_path):
    write_png(tmp_path / "a.png", np.zeros((31, 41, 3), np.uint8))
    write_png(tmp_path / "b.png", np.zeros((37, 41, 3), np.uint8))
    write_exr(tmp_path / "c.exr", {"R": np.zeros((31, 41), np.float32)})
    assert "equal sizes" in refused("compare", tmp_path / "a.png", tmp_path / "b.png")
    assert "cannot be compared" in refused("compare", tmp_path / "a.png", tmp_path / "c.exr")
    assert "equal sizes" in refused("compare", tmp_path / "a.png", tmp_path / "a.png", "--mask", tmp_path / "b.png")
