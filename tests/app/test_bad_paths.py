"""Files are read only where they may lie, and only files: no link leads out of a folder, and no pipe is waited for."""

import json
import os
import shutil
import socket
import sys
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from fuzz.pictures import rendered
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file, inside, read_bytes
from hagoromo.files.exr import write_exr
from hagoromo.files.format import formats
from hagoromo.files.png import write_png
from hagoromo.files.table import write_table
from hagoromo.measurement.measurement_files import read_surface

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="pipes and links are made otherwise there")


@pytest.fixture
def pipe(tmp_path):
    """Makes a pipe of a name; a reader that opened it would wait for ever."""

    def make(name: str) -> Path:
        os.mkfifo(tmp_path / name)
        return tmp_path / name

    return make


SUFFIXES = dict.fromkeys(suffix for form in formats() if not form.folder for suffix in form.suffixes if suffix)


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_a_pipe_is_refused_and_not_waited_for(refused, pipe, suffix):
    path = pipe(f"a{suffix}")
    assert refused("info", path) == f"hagoromo: {path} is a pipe: give a file on a disk\n"


def test_verbs_do_not_wait_for_pipes(refused, capture, pipe, tmp_path):
    out = "--out", tmp_path / "out"
    fifo = {suffix: pipe(f"a.{suffix}") for suffix in ("toml", "exr", "json", "csv", "png")}
    assert "is a pipe" in refused("render", fifo["toml"], "--out", tmp_path / "a2.exr")
    assert "is a pipe" in refused("build", fifo["toml"], *out)
    assert "is a pipe" in refused("convert", fifo["json"], *out)
    assert "is a pipe" in refused("compare", fifo["png"], fifo["exr"])
    lamps = "--lamps", fifo["json"]
    assert "is a pipe" in refused("capture", next((capture / "images").iterdir()), *lamps, *out)
    assert "is a pipe" in refused("develop", fifo["exr"], "--out", tmp_path / "a2.exr")


@pytest.mark.parametrize(("path", "said"), [("/dev/zero", "is a device"), ("/dev/null", "is a device")])
def test_devices_are_refused(refused, tmp_path, path, said):
    (tmp_path / "a.json").symlink_to(path)
    assert said in refused("info", tmp_path / "a.json")
    with pytest.raises(InputError, match=said):
        read_bytes(path)


def test_sockets_loops_of_links_and_impossible_names_are_refused(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the path of a socket is short
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("a.sock")
        with pytest.raises(InputError, match="is a socket"):
            existing_file("a.sock")
    Path("a").symlink_to("b")
    Path("b").symlink_to("a")
    for name in ("a", "n" * 300, "a\0b"):
        with pytest.raises(InputError, match="cannot be opened"):
            existing_file(name)


def test_inside_resolves_links(tmp_path):
    home, secret = tmp_path / "home", tmp_path / "home_2"  # of a name that begins alike
    (home / "deep").mkdir(parents=True)
    secret.mkdir()
    (secret / "a.png").touch()
    (home / "deep" / "a.png").touch()
    (home / "link.png").symlink_to("deep/a.png")
    (home / "out").symlink_to(secret)
    (home / "absent").symlink_to(secret / "absent.png")
    (tmp_path / "alias").symlink_to(home)
    assert inside(home, "link.png") == home / "link.png"
    assert inside(tmp_path / "alias", "link.png") == tmp_path / "alias" / "link.png"
    for name in ("out", "out/a.png", "deep/../out/a.png", "absent"):
        with pytest.raises(InputError, match="leads outside"):
            inside(home, name)
    for name in ("..", "deep/../../home_2/a.png", str(secret / "a.png"), "a\0b"):
        with pytest.raises(InputError):
            inside(home, name)


def moved_out(folder: Path, name: str) -> None:
    """Replace a file of `folder` by a link to the same file outside."""
    outside = folder.parent / "elsewhere"
    outside.mkdir(exist_ok=True)
    shutil.move(folder / name, outside / Path(name).name)
    (folder / name).symlink_to(outside / Path(name).name)


def with_everything(capture: Path) -> None:
    """Masks, a spectrum and a profile of a lamp, named in the file of the capture."""
    record = json.loads((capture / "transforms.json").read_text())
    height, width = record["h"], record["w"]
    write_png(capture / "mask.png", np.full((height, width), 255, np.uint8))
    (capture / "red.csv").write_text("wavelength_nm,value\n400,1\n700,2\n")
    (capture / "lamp.ies").write_text(
        "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 1 1 2 0 0 0\n1 1 10\n0 45 90\n0\n100 50 0\n"
    )
    record["frames"][0]["mask_path"] = "mask.png"
    record["lamps"][0] |= {"spectrum": "red.csv", "profile": "lamp.ies"}
    (capture / "transforms.json").write_text(json.dumps(record))


@pytest.mark.parametrize(
    "name",
    ["transforms.json", "images/0000.exr", "mask.png", "red.csv", "lamp.ies", "normals.exr", "points.exr",
     "canon_eos_300d.csv"],
)  # fmt: skip
def test_a_link_of_a_capture_that_leads_outside_is_refused(refused, capture, tmp_path, name):
    with_everything(capture)
    moved_out(capture, name)
    assert "leads outside" in refused("measure", capture, "--out", tmp_path / "measured")


def test_a_link_beside_a_name_without_suffix_is_resolved(refused, capture, tmp_path):
    write_png(tmp_path / "a.png", np.zeros((47, 61, 3), np.uint16))
    (capture / "a.png").symlink_to(tmp_path / "a.png")
    record = json.loads((capture / "transforms.json").read_text())
    record["frames"][0]["file_path"] = "a"
    for table in (record, *record["frames"]):  # the size is that of the image
        for key in {"w", "h"} & set(table):
            del table[key]
    (capture / "transforms.json").write_text(json.dumps(record))
    assert "leads outside" in refused("measure", capture, "--out", tmp_path / "measured")
    assert "leads outside" in refused("convert", capture, "--out", tmp_path / "a.yml")


@pytest.mark.parametrize(
    ("table", "name"),
    [
        (
            '[[surface]]\nmesh = "{0}"\nreflectance = {{alpha = 0, beta = 0, gamma = 1, n = 1, body_colour = 1}}\n',
            "a.ply",
        ),
        ('[[box]]\nfile = "{0}"\n', "a.zarr"),
        ('[[box]]\nrecipe = "{0}"\n', "a.toml"),
        ('[[lamp]]\nto_lamp = [0, 0, 1]\nspectrum = "{0}"\n', "a.csv"),
        ('[[lamp]]\nposition = [0, 0, 1]\nprofile = "{0}"\n', "a.ies"),
        ('[[box]]\nfile = "slab.zarr"\nmaterials = [{{file = "{0}", material = "a"}}]\n', "a.json"),
    ],
)
def test_a_link_of_a_scene_that_leads_outside_is_refused(refused, scene, box, tmp_path, table, name):
    path = tmp_path / "scenes" / "scene.toml"
    path.parent.mkdir()
    shutil.move(scene(more=table.format(name)), path)
    shutil.move(box, path.parent / box.name)
    (tmp_path / name).touch()
    (path.parent / name).symlink_to(tmp_path / name)
    assert "leads outside" in refused("render", path, "--out", tmp_path / "a.exr")


def test_a_link_of_a_recipe_that_leads_outside_is_refused(refused, tmp_path, recipe):
    (tmp_path / "home").mkdir()
    (tmp_path / "a.ply").touch()
    (tmp_path / "home" / "a.ply").symlink_to(tmp_path / "a.ply")
    text = recipe.replace(
        'kind = "skin"\nsize_mm = 6.0', 'kind = "solid"\nshape = {form = "mesh", file = "a.ply", height_mm = 5.0}'
    )
    (tmp_path / "home" / "matter.toml").write_text(text)
    assert "leads outside" in refused("build", tmp_path / "home" / "matter.toml", "--out", tmp_path / "matter.zarr")


def test_a_link_of_a_measurement_or_of_colmap_that_leads_outside_is_refused(refused, tmp_path):
    for name in ("materials.json", "cameras.bin"):
        (tmp_path / name).write_text("[]")
        (tmp_path / "home").mkdir(exist_ok=True)
        (tmp_path / "home" / name).symlink_to(tmp_path / name)
    with pytest.raises(InputError, match="leads outside"):
        read_surface(tmp_path / "home")
    assert "leads outside" in refused("info", tmp_path / "home")


@pytest.fixture(params=["absolute", "..", "a link"])
def outside(request, tmp_path):
    """How a file in tmp_path/home names the spectrum beside that folder."""
    home = tmp_path / "home"
    home.mkdir()
    write_table(tmp_path / "secret.csv", {"wavelength_nm": [400, 700], "value": [0.5, 0.5]})
    (home / "link.csv").symlink_to(tmp_path / "secret.csv")
    return {"absolute": str(tmp_path / "secret.csv"), "..": "../secret.csv", "a link": "link.csv"}[request.param]


def named_outside(said: str) -> bool:
    return "points outside" in said or "leads outside" in said


@pytest.mark.parametrize("key", ["bodies", "lamps", "bands"])
def test_a_picture_names_no_file_of_a_spectrum(refused, outside, tmp_path, key):
    """Pictures have their spectra in them; one that names a file could read any file of the machine."""
    flat = hg.Spectrum.constant(1.0).record()
    record = {"bodies": [flat], "interfaces": [flat], "lamps": [flat], "lamp_names": ["a"], "lamp_groups": [0]}
    rendered(tmp_path / "home" / "a.exr", json.dumps(record | {key: [outside]}).encode())
    said = refused("expose", tmp_path / "home" / "a.exr", "--out", tmp_path / "b.exr")
    assert "must be a table of keys" in said


def test_a_spectrum_that_a_box_names_lies_in_it(refused, outside, box, tmp_path):
    """Of its materials, and the basis of its colours."""
    home = tmp_path / "home" / "slab.zarr"
    shutil.move(box, home)
    name = outside if outside.startswith("/") else f"../{outside}"
    attributes = json.loads((home / "zarr.json").read_text())
    for change in (
        {"basis": [name]},
        {"materials": [attributes["attributes"]["hagoromo"]["materials"][0] | {"body_colour": name}]},
    ):
        spoilt = json.loads(json.dumps(attributes))
        spoilt["attributes"]["hagoromo"] |= change
        (home / "zarr.json").write_text(json.dumps(spoilt))
        assert named_outside(refused("info", home))


@pytest.mark.parametrize("key", ["file", "body_colour", "interface_colour"])
def test_what_the_material_of_a_conversion_names_lies_in_its_folder(refused, outside, tmp_path, key):
    np.save(tmp_path / "a.npy", np.ones((4, 5, 6), np.float32))
    table = {"alpha": 0.2, "beta": 0.1, "gamma": 0.2, "n": 1.5, "body_colour": 0.8}
    table = {"file": outside, "material": "a"} if key == "file" else table | {key: outside}
    lines = [f"{name} = {json.dumps(value)}" for name, value in table.items()]
    (tmp_path / "home" / "m.toml").write_text("\n".join(["[material]", *lines]))
    options = "--material", tmp_path / "home" / "m.toml", "--out", tmp_path / "a.zarr"
    assert named_outside(refused("convert", tmp_path / "a.npy", *options))


def test_names_that_are_not_in_utf8_are_refused(refused, tmp_path):
    """OpenCV ended the process over them, OpenEXR and printing raised: as input, output, and folder above it."""
    odd = os.fsdecode(b"\xff\xfe d\xe9")
    (tmp_path / odd).mkdir()
    picture = tmp_path / "a.exr"
    write_exr(picture, {name: np.ones((3, 5)) for name in "RGB"})
    for suffix in (".exr", ".png", ".json", ".toml", ".csv", ".yml"):
        (tmp_path / odd / f"a{suffix}").touch()
        assert "is not in UTF-8" in refused("info", tmp_path / odd / f"a{suffix}")
    assert "is not in UTF-8" in refused("compare", picture, tmp_path / odd / "a.exr")
    for out in (tmp_path / odd / "b.exr", tmp_path / f"{odd}.exr"):
        assert "is not in UTF-8" in refused("expose", picture, "--out", out)
    with pytest.raises(InputError, match="is not in UTF-8"):
        write_exr(tmp_path / odd / "b.exr", {"R": np.ones((3, 5))})


def test_a_question_mark_in_a_name_is_part_of_it(tmp_path):
    """OpenCV takes what follows it for options, and opened another file."""
    (tmp_path / "a?[b]").mkdir()
    camera = hg.Camera(64, 48, (90.0, 91.0), (32.5, 24.0))
    hg.write_views(tmp_path / "a?[b]" / "c?base64.yml", {"": camera}, "opencv")
    assert hg.read_views(tmp_path / "a?[b]" / "c?base64.yml")[""].focal == camera.focal
