"""`render --mode path` on the command line, and what it refuses."""

import sys

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.image.path.walk_sums import WalkSums


def test_a_scene_is_rendered_in_all_orders_and_exposed_again(scene, tmp_path):
    picture, warm = tmp_path / "a.exr", tmp_path / "b.exr"
    command = ["render", str(scene()), "--mode", "path", "--samples", "4", "--seed", "3", "--separate-lamps"]
    assert main([*command, "--out", str(picture)]) == 0
    image = hg.read_image(picture)
    assert image.metadata["mode"] == "path" and image.metadata["walks"] == 4 and len(image.palette.bands) >= 3
    assert image.variance is not None and np.isfinite(image.variance).all()
    assert main(["expose", str(picture), "--spectrum", "key=A", "--out", str(warm)]) == 0
    assert not np.allclose(hg.read_image(warm).linear_srgb(), image.linear_srgb())


def test_settings_of_walks_are_refused_where_there_are_none(refused, scene, tmp_path):
    for more in (("--error", 0.05), ("--time", 3)):
        assert "is for mode path" in refused("render", scene(), "--out", tmp_path / "a.exr", *more)
    assert "error is 2" in refused("render", scene(), "--out", tmp_path / "a.exr", "--mode", "path", "--error", 2)


def test_a_box_that_gains_light_is_refused_by_what_it_is_and_what_to_do(refused, scene, box, tmp_path):
    said = refused("render", scene(more='[[box]]\nfile = "slab.zarr"\n'), "--mode", "path", "--out", tmp_path / "a.exr")
    assert "'slab' has isotropic extinction" in said and 'set extinction = "projected"' in said


def test_an_interrupt_leaves_the_picture_so_far_and_resume_goes_on(scene, tmp_path, monkeypatch, capsys, refused):
    """To the bits of an uninterrupted run, with the same scene; a finished picture is not resumed."""
    picture, whole = tmp_path / "a.exr", tmp_path / "b.exr"
    command = ["render", str(scene()), "--mode", "path", "--samples", "6", "--out"]
    monkeypatch.setattr("hagoromo.image.path.picture.launch_size", lambda channels: 500)
    assert main([*command, str(whole)]) == 0
    add, left = WalkSums.add, iter(range(3))

    def interrupted(sums, *launch):
        add(sums, *launch)
        if next(left, None) is None:
            raise KeyboardInterrupt

    monkeypatch.setattr(WalkSums, "add", interrupted)
    assert main([*command, str(picture)]) == 130
    said = capsys.readouterr().err.splitlines()[-1]
    assert "walks a pixel" in said and f"{picture} is the picture so far: --resume goes on with it" in said
    assert picture.with_suffix(".png").exists() and "walks a pixel" in hg.info(picture)["unfinished"]
    monkeypatch.setattr(WalkSums, "add", add)
    assert main([*command, str(picture), "--resume"]) == 0
    one, other = hg.read_image(picture), hg.read_image(whole)
    assert np.array_equal(one.weights, other.weights) and one.sums is None
    assert "not unfinished" in refused(*command, picture, "--resume")
    assert "nothing to resume" in refused(*command, tmp_path / "c.exr", "--resume")


def test_denoising_asks_for_its_extra(monkeypatch, scene, refused, tmp_path):
    monkeypatch.setitem(sys.modules, "pyoidn", None)
    assert "pip install 'hagoromo[denoise]'" in refused("render", scene(), "--denoise", "--out", tmp_path / "a.exr")


def test_the_command_writes_layers(scene, tmp_path):
    assert main(["render", str(scene()), "--layers", "--out", str(tmp_path / "a.exr")]) == 0
    assert "depth.Z" in hg.info(tmp_path / "a.exr")["channels"]


@pytest.mark.nightly
def test_full_says_what_it_is_off_on_the_screen_and_in_the_file(scene, tmp_path, capsys):
    picture, bare = tmp_path / "a.exr", tmp_path / "b.exr"
    command = ["render", str(scene()), "--mode", "full"]
    assert main([*command, "--walks", "2000", "--out", str(picture)]) == 0
    assert "mode full: mean " in capsys.readouterr().out
    assert main(["info", str(picture)]) == 0
    assert "without their mend" in capsys.readouterr().out
    assert main([*command, "--walks", "0", "--out", str(bare)]) == 0
    assert "mode full" not in capsys.readouterr().out and hg.read_image(bare).full_error is None
