"""Bad input ends with one line on standard error, status 2 and nothing half-written."""

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.files.record import write_json
from hagoromo.files.table import write_table


@pytest.fixture
def refused(capsys, tmp_path):
    """Run a verb that must be refused; gives the line it said."""

    def run(*arguments) -> str:
        before = sorted(tmp_path.rglob("*"))
        capsys.readouterr()
        status = main([str(argument) for argument in arguments])
        said = capsys.readouterr()
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
        write_json(path, [{"name": "silk", "alpha": 0.1}])
    elif kind == "toml":
        path.write_text('[camera]\npreset = "canon_eos_kiss_digital"\n[[lamps]]\nname = "key"\n')
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
    assert "could not convert" in refused(
        "calibrate", "camera", "--board", "9x6", "--square", "wide", "--out", "a.json"
    )


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

    monkeypatch.setattr("hagoromo.camera.calibrate.find_corners", interrupted)
    arguments = ["calibrate", "camera", str(tmp_path / "a.png"), "--board", "9x6", "--square", "0.025"]
    assert main([*arguments, "--out", str(tmp_path / "new" / "camera.json")]) == 130
    assert capsys.readouterr().err == "hagoromo: interrupted: nothing was written\n"
    assert [path for path in tmp_path.rglob("*") if path.is_file()] == before
