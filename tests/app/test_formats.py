"""The table of formats: what it names exists, its page is made of it, and one finder serves `info` and `convert`."""

import shutil

import numpy as np
import pytest

from docs.hooks.formats import page
from hagoromo.app.cli import main
from hagoromo.app.info import info
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_views, write_views
from hagoromo.errors import InputError
from hagoromo.files.format import format_of, formats, function_at, installed
from tests.files.test_volume_files import SAMPLES

PLACES = ("reader", "writer", "sniff", "facts", "as_scene", "triangles", "mesh_writer")
VIEWS = {"a.png": Camera(40, 30, (50.0, 50.0), (20.0, 15.0)).with_pose(np.eye(4))}


def test_every_format_has_what_its_row_names():
    assert len({form.name for form in formats()}) == len(formats())
    for form in formats():
        places = (getattr(form, name) for name in PLACES)
        assert all(callable(function_at(place)) for place in places if place) and form.reader, form.name
        assert form.lost, f"{form.name}: say what is lost"
        own = form.holds in ("matter", "result") or form.name == "capture"
        assert own or form.judge, f"{form.name}: name what the tests compare with"


def test_the_page_of_formats_has_every_format():
    text = page()
    for form in formats():
        assert f"| {form.name} |" in text


@pytest.mark.parametrize("suffix", [".json", ".yml"])
def test_a_file_without_a_suffix_is_known_by_what_it_holds(tmp_path, suffix):
    """Both verbs find it: `info` did, `convert` did not."""
    write_views(tmp_path / f"a{suffix}", VIEWS)
    shutil.copy(tmp_path / f"a{suffix}", tmp_path / "cameras")
    assert main(["convert", str(tmp_path / "cameras"), "--out", str(tmp_path / "b.yml")]) == 0
    assert read_views(tmp_path / "b.yml").keys() == VIEWS.keys()
    assert format_of(tmp_path / "cameras") is format_of(tmp_path / f"a{suffix}")


@pytest.mark.parametrize("name", ["a.nrrd", "a.vol"])
def test_volumes_without_a_suffix_are_known_by_their_first_bytes(tmp_path, name):
    (tmp_path / "volume").write_bytes(SAMPLES[name][0])
    assert format_of(tmp_path / "volume").suffixes[0] == name[1:]


def test_text_that_is_no_camera_is_not_taken_for_one(tmp_path, capsys):
    (tmp_path / "notes.txt").write_text("the lamp hangs to the left\n")
    for verb in (["info"], ["convert", "--out", str(tmp_path / "a.json")]):
        assert main([verb[0], str(tmp_path / "notes.txt"), *verb[1:]]) == 2
        said = capsys.readouterr().err
        assert "notes.txt" in said and ".nrrd" in said and ".yml" in said and said.count("\n") == 1


def test_info_knows_a_mesh(tmp_path):
    (tmp_path / "a.off").write_text("OFF\n4 4 0\n0 0 0\n1 0 0\n0 1 0\n0 0 2\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n")
    facts = info(tmp_path / "a.off")
    assert facts["triangles"] == 4 and facts["high"] == [1, 1, 2] and facts["closed"]


def test_a_folder_that_is_split_as_nerfs_are_is_known_to_both_verbs(tmp_path):
    """NeRF's synthetic scenes have transforms_train.json, and no transforms.json."""
    write_views(tmp_path / "transforms_train.json", VIEWS, "nerfstudio")
    assert info(tmp_path)["frames"] == 1
    assert main(["convert", str(tmp_path), "--out", str(tmp_path / "b.yml")]) == 0
    assert read_views(tmp_path / "b.yml").keys() == VIEWS.keys()


def test_sources_that_are_not_installed_say_so():
    """They gave an empty list of formats: seen where the sources alone had been sent to a machine with a card."""
    with pytest.raises(InputError, match=r"not installed here: nothing is registered as hagoromo\.unknown: pip"):
        installed("hagoromo.unknown")
