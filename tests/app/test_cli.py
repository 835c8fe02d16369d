"""The command line answers at once, and each verb writes what it says."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import hagoromo
from fuzz import pictures, volumes
from hagoromo.app.cli import main
from hagoromo.app.verb import abouts, unbroken
from hagoromo.files import apart
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.hdr import write_hdr
from hagoromo.files.picture import read_picture
from hagoromo.files.png import write_png
from hagoromo.files.record import read_json, write_json
from hagoromo.files.table import read_table, write_table
from tests.ball_scene import ball_scene, lamp
from tests.data import DATA, real_data

HEAVY = ("numpy", "drjit", "mitsuba", "colour", "matplotlib", "cv2", "scipy", "zarr", "distributed")
CHROME, BOARD = DATA / "uw_psm" / "chrome", DATA / "opencv_left" / "left"
SCENE = ball_scene(
    (97, 71), 150.0, [lamp("", *at, intensity="") for at in ((0.5, -2.0, 1.0), (-0.5, -2.0, 1.0), (0.0, -1.5, 2.0))]
)


def test_help_loads_little():
    """Some 280 modules beside Python's own, none of them heavy: half a second on an idle machine of 2020."""
    code = """
import sys
before = len(sys.modules)
from hagoromo.app.cli import main
from hagoromo.app.verb import abouts, unbroken
try:
    main(["--help"])
except SystemExit as end:
    assert end.code == 0
print("modules", len(sys.modules) - before, *(name for name in HEAVY if name in sys.modules))
"""
    command = [sys.executable, "-c", f"HEAVY = {HEAVY}{code}"]
    shown = subprocess.run(command, capture_output=True, text=True, check=True).stdout
    assert "info" in shown and "calibrate" in shown
    _, count, *heavy = shown.splitlines()[-1].split()
    assert int(count) < 500 and not heavy


def test_help_has_a_line_or_two_for_each_command(monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", "80")
    assert main(["--help"]) == 0
    shown = capsys.readouterr().out
    listed = shown.partition("says more:")[2].splitlines()[2:]
    names = [line.split()[0] for line in listed if line[2] != " "]
    assert names == sorted(abouts) and len(names) > 30
    assert main(["--quiet", "-h"]) == 0 and capsys.readouterr().out == shown
    assert max(map(len, shown.splitlines())) <= 80 and len(listed) <= 2 * len(names)


def test_help_of_an_option_is_broken_where_the_terminal_ends():
    assert unbroken("Does.\n\n    Args:\n        one: first\n            and more.\n        two: it.\n    ") == (
        "Does.\n\nArgs:\n    one: first and more.\n    two: it."
    )


def test_a_word_that_is_no_command_is_one_line_with_the_nearest(capsys):
    assert main(["rendr", "x.toml"]) == main(["zzz"]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "hagoromo: 'rendr' is no command: give render, or see `hagoromo --help`",
        "hagoromo: 'zzz' is no command: see `hagoromo --help`",
    ]


def test_without_a_command_one_line_says_how_to_list_them(capsys):
    assert main([]) == main(["--quiet"]) == 2
    assert capsys.readouterr().err == 2 * "hagoromo: no command was given: `hagoromo --help` lists them\n"


def test_version_is_that_of_the_package(capsys):
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"hagoromo {hagoromo.__version__}\n"


def test_calibrate_response_writes_the_curves(tmp_path, capsys):
    random = np.random.default_rng(3)
    wavelengths = np.arange(400, 701, 20)
    spectra = np.exp(-0.5 * ((wavelengths - random.uniform(400, 700, (29, 1))) / 30) ** 2)
    readings = spectra @ np.linspace(0.1, 1.0, len(wavelengths))
    columns = {"R": readings, **{str(w): spectra[:, k] for k, w in enumerate(wavelengths)}}
    write_table(tmp_path / "pairs.csv", columns)
    out = tmp_path / "response.csv"
    assert main(["calibrate", "response", str(tmp_path / "pairs.csv"), "--out", str(out)]) == 0
    assert f"wrote {out}" in capsys.readouterr().out
    assert list(read_table(out)) == ["wavelength_nm", "R"]


@real_data("opencv_left")
def test_calibrate_camera_writes_the_lens(tmp_path, capsys):
    photographs = [str(path) for path in sorted(BOARD.glob("left0[1-5].jpg"))]
    out = tmp_path / "camera.json"
    assert main(["calibrate", "camera", *photographs, "--board", "9x6", "--square", "0.025", "--out", str(out)]) == 0
    assert "over 5 photographs" in capsys.readouterr().out
    assert read_json(out)["w"] == 640


def test_info_tells_what_is_in_every_kind_of_file(tmp_path, capsys):
    write_exr(tmp_path / "a.exr", {"R": np.full((5, 7), 0.5), "N.X": np.zeros((5, 7))}, {"note": "here"})
    write_png(tmp_path / "a.png", np.full((5, 7, 3), 1000, np.uint16))
    write_hdr(tmp_path / "a.hdr", np.ones((5, 7, 3)))
    write_table(tmp_path / "a.csv", {"wavelength_nm": [400, 700], "R": [0, 1]})
    write_json(tmp_path / "lamps.json", {"lamps": [{"to_lamp": [0, 0, 1]}]})
    (tmp_path / "a.toml").write_text("[skin]\ntau = 3\n")
    (tmp_path / "capture").mkdir()
    write_json(tmp_path / "capture" / "transforms.json", {"w": 7, "h": 5, "frames": [{}, {}]})
    for name, said in [
        ("a.exr", ["EXR image", "[7, 5]", "N.X", "note: here"]),
        ("a.hdr", ["HDR image", "[7, 5]"]),
        ("a.png", ["picture", "bits: 16", "[7, 5]"]),
        ("a.csv", ["table", "rows: 2", "R: [0.0, 1.0]"]),
        ("lamps.json", ["lamps", "to_lamp"]),
        ("a.toml", ["matter", "tau"]),
        ("capture", ["capture", "frames: 2"]),
    ]:
        assert main(["info", str(tmp_path / name)]) == 0
        shown = capsys.readouterr().out
        assert all(word in shown for word in said), shown


@pytest.mark.parametrize("name", ["a.exr", "a.hdr", "a.png", "a.jpg", "a.tif", "a.dng", "a.nii.gz", "a.npy"])
def test_info_reads_headers_alone_unless_it_is_asked(tmp_path, capsys, monkeypatch, name):
    """What decodes is taken away; the range of the pixels is what --decode says besides."""
    write = {
        "a.exr": pictures.exr, "a.hdr": pictures.hdr, "a.png": pictures.png, "a.jpg": pictures.jpeg,
        "a.tif": pictures.tiff_lzw, "a.dng": pictures.dng, "a.nii.gz": volumes.nifti, "a.npy": volumes.npy,
    }  # fmt: skip
    write[name](tmp_path / name)
    assert main(["info", str(tmp_path / name), "--decode"]) == 0
    whole = capsys.readouterr().out.splitlines()
    asked = apart._asked

    def headers_alone(helper, task, seconds):
        assert not re.search(rb"pixels_by|raw_by|channels_by|numbers_by", task), task
        return asked(helper, task, seconds)

    def fails(*_):
        raise AssertionError("pixels are read")

    monkeypatch.setattr(apart, "_asked", headers_alone)
    monkeypatch.setattr("hagoromo.files.exr.read_lines", fails)
    assert main(["info", str(tmp_path / name)]) == 0
    headers = capsys.readouterr().out.splitlines()
    assert len(headers) >= 3 and set(headers) < set(whole)
    assert name == "a.dng" or any("[" in line for line in set(whole) - set(headers))


def test_jpeg_is_read_whole_or_refused(tmp_path):
    """Quality 95 of a smooth picture, colour stored at half resolution: within 6 of 255."""
    import cv2

    from hagoromo.errors import InputError

    row, column = np.mgrid[:53, :71]
    image = np.stack([row * 4, column * 3, 0 * row + 90], axis=-1).astype(np.uint8)
    data = cv2.imencode(".jpg", image[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, 95])[1].tobytes()
    (tmp_path / "a.jpg").write_bytes(data)
    assert np.abs(read_picture(tmp_path / "a.jpg").astype(int) - image).max() <= 6
    for share in (0.01, 0.1, 0.5, 0.99):
        (tmp_path / "a.jpg").write_bytes(data[: int(share * len(data))])
        with pytest.raises(InputError):
            read_picture(tmp_path / "a.jpg")


def test_a_bug_is_a_traceback_not_a_line(monkeypatch):
    def broken(*_):
        raise ZeroDivisionError

    monkeypatch.setattr("hagoromo.info", broken)
    with pytest.raises(ZeroDivisionError):
        main(["info", "a.png"])


def test_records_are_plain_json(tmp_path, capsys):
    write_json(tmp_path / "camera.json", {"fl_x": 1.0, "standard_deviation": {"fl_x": 0.1}})
    assert main(["info", str(tmp_path / "camera.json")]) == 0
    lines = dict(line.split(": ", 1) for line in capsys.readouterr().out.splitlines())
    assert json.loads(lines["standard_deviation"]) == {"fl_x": 0.1}


@real_data("uw_psm")
def test_calibrate_lamps_writes_lamps_that_a_capture_can_list(tmp_path, capsys):
    """The laboratory read (0.4934, 0.4695, 0.7322) off the ball for lamp 0, with a mask a pixel beside it: 1.5°."""
    from hagoromo.photograph.transforms import lamp_from_record

    photographs = [str(CHROME / f"chrome.{k}.png") for k in range(3)]
    out = tmp_path / "lamps.json"
    assert main(["calibrate", "lamps", *photographs, "--mask", str(CHROME / "chrome.mask.png"), "--out", str(out)]) == 0
    assert "chrome.0.png: to_lamp" in capsys.readouterr().out
    lamps = [lamp_from_record(lamp, tmp_path, "lamps.json") for lamp in read_json(out)["lamps"]]
    assert len(lamps) == 3 and lamps[0].to_lamp is not None
    assert np.degrees(np.arccos(lamps[0].to_lamp @ [0.493408, 0.469501, 0.732201])) < 1.5


def test_a_scene_is_photographed_measured_rendered_and_compared(tmp_path, capsys):
    """From a scene file to its reflectance; what each verb says it wrote is there."""
    scene = tmp_path / "scene.toml"
    scene.write_text(SCENE)
    for verb, given, out, files in [
        ("simulate", "scene.toml", "capture", ["transforms.json", "points.exr", "normals.exr"]),
        ("measure", "capture", "measured", ["materials.json", "normals.exr", "labels.png", "report.html"]),
        ("render", "scene.toml", "image.exr", []),
    ]:
        assert main([verb, str(tmp_path / given), "--out", str(tmp_path / out)]) == 0
        wrote = [Path(line[6:]) for line in capsys.readouterr().out.splitlines() if line.startswith("wrote ")]
        assert wrote and all(path.exists() for path in wrote)
        assert all((tmp_path / out / name).is_file() for name in files)
    assert main(["compare", str(tmp_path / "image.exr"), str(tmp_path / "image.exr")]) == 0
    assert json.loads(capsys.readouterr().out)["relative_rmse"] == 0.0
    for name, said in [("scene.toml", "ball"), ("capture", "frames: 3"), ("measured/materials.json", "identifiable")]:
        assert main(["info", str(tmp_path / name)]) == 0
        assert said in capsys.readouterr().out
    page = (tmp_path / "measured" / "report.html").read_text(encoding="utf-8")
    for name in ("ns/anno.jsonld", "TR/media-frags/"):  # of the form of notes: names, which nothing loads
        page = page.replace(f"http://www.w3.org/{name}", "", 1)
    assert "material 1" in page and "data:image" in page and not re.search(r"https?:", page)


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


def test_a_recipe_is_built_into_a_box_that_a_scene_renders(tmp_path, capsys):
    (tmp_path / "skin.toml").write_text(RECIPE)
    box = tmp_path / "skin.zarr"
    assert main(["build", str(tmp_path / "skin.toml"), "--out", str(box)]) == 0
    assert f"wrote {box}" in capsys.readouterr().out
    assert main(["info", str(box)]) == 0
    assert "hold matter" in capsys.readouterr().out
    scene = SCENE[: SCENE.index("[[surface]]")].replace("eye = [0.0, -1.0, 0.0]", "eye = [0.0, -0.03, 0.003]")
    (tmp_path / "scene.toml").write_text(scene + '[[box]]\nfile = "skin.zarr"\n')
    assert main(["render", str(tmp_path / "scene.toml"), "--out", str(tmp_path / "skin.exr")]) == 0
    assert read_exr(tmp_path / "skin.exr")[0]["A"].max() > 0.99


@pytest.mark.nightly
def test_a_capture_of_unknown_shape_is_measured_from_many_lamps(tmp_path, capsys):
    """Eight far lamps. Tolerance: 1° on average, three times what 12 bits and pixels at the rim leave."""
    lamps = [f"[[lamp]]\nto_lamp = [{0.6 * np.cos(a)}, -1.0, {0.6 * np.sin(a)}]\n" for a in np.arange(8) * np.pi / 4]
    camera, ball = SCENE[: SCENE.index("[[lamp]]")], SCENE[SCENE.index("[[surface]]") :]
    (tmp_path / "scene.toml").write_text(camera + "".join(lamps) + ball)
    capture = tmp_path / "capture"
    assert main(["simulate", str(tmp_path / "scene.toml"), "--out", str(capture)]) == 0
    record = read_json(capture / "transforms.json")
    write_json(
        capture / "transforms.json", {k: v for k, v in record.items() if k not in ("points_path", "normals_path")}
    )
    assert main(["measure", str(capture), "--out", str(tmp_path / "measured")]) == 0
    true, found = (
        np.stack([read_exr(folder / "normals.exr")[0][f"N.{axis}"] for axis in "XYZ"], axis=2)
        for folder in (capture, tmp_path / "measured")
    )
    known = (np.linalg.norm(true, axis=2) > 0.5) & (np.linalg.norm(found, axis=2) > 0.5)
    angle = np.degrees(np.arccos(np.clip(np.sum(true * found, axis=2)[known], -1.0, 1.0)))
    assert known.sum() > 1400 and angle.mean() < 1.0
