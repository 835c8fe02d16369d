"""Options of every command, and recipes by name: what is allowed is read, the rest refused; messages as asked for."""

import logging
import os

import pytest

from hagoromo.app.cli import main
from hagoromo.app.everywhere import Everywhere, everywhere, taken
from hagoromo.app.progress_bar import progress_bar
from hagoromo.errors import InputError
from hagoromo.files.checks import ALLOWED, inside
from hagoromo.image.scene.scene_file import _recipe_place, load_scene
from hagoromo.matter.recipe import planned, recipe_place, shipped_recipes, summary
from tests.ball_scene import KEY, camera

SOLID = """
kind = "solid"
voxel_mm = 1.0
shape = { form = "sphere", radius_mm = 3.0 }
material = { alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 0.8 }
"""


@pytest.fixture
def scene(tmp_path):
    """A scene that names a recipe beside its folder."""
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "scenes").mkdir()
    (tmp_path / "elsewhere" / "solid.toml").write_text(SOLID)
    path = tmp_path / "scenes" / "scene.toml"
    path.write_text(camera((8, 8), 20.0) + KEY + '\n[[box]]\nrecipe = "../elsewhere/solid.toml"\n')
    return path


def test_a_file_of_another_folder_needs_leave(scene, refused, tmp_path):
    said = refused("info", scene)
    assert "points outside" in said and "--allow" in said
    assert "points outside" in refused("info", scene, "--allow", tmp_path / "scenes")
    assert main(["info", str(scene), "--allow", str(tmp_path / "elsewhere")]) == 0
    assert main([f"--allow={tmp_path / 'elsewhere'}", "info", str(scene)]) == 0
    assert ALLOWED not in os.environ  # leave is given for one command
    assert "--allow needs a folder" in refused("info", scene, "--allow", tmp_path / "absent")
    assert "--allow needs a folder" in refused("info", scene, "--allow")


def test_leave_for_a_folder_is_none_for_what_its_links_lead_to(tmp_path, monkeypatch):
    for name in ("home", "allowed", "secret"):
        (tmp_path / name).mkdir()
    (tmp_path / "secret" / "a.csv").write_text("1")
    (tmp_path / "allowed" / "a.csv").symlink_to(tmp_path / "secret" / "a.csv")
    (tmp_path / "allowed" / "b.csv").write_text("1")
    monkeypatch.setenv(ALLOWED, str(tmp_path / "allowed"))
    assert inside(tmp_path / "home", "../allowed/b.csv").is_file()
    assert inside(tmp_path / "home", str(tmp_path / "allowed" / "b.csv")).is_file()
    for wrong in ("../allowed/a.csv", "../allowed/../secret/a.csv", "../allowed2/b.csv"):
        with pytest.raises(InputError, match="points outside"):
            inside(tmp_path / "home", wrong)
    monkeypatch.setenv(ALLOWED, ".")  # a relative folder gives no leave
    with pytest.raises(InputError, match="points outside"):
        inside(tmp_path / "home", "../allowed/b.csv")


def test_shipped_recipes_are_taken_by_name(tmp_path, monkeypatch, refused):
    names = shipped_recipes()
    assert {"linen", "skin", "wing"} <= set(names) and all(map(summary, names.values()))
    monkeypatch.chdir(tmp_path)
    assert planned("solid")[0].header.name == planned(names["solid"])[0].header.name
    assert _recipe_place(tmp_path, "linen") == names["linen"]
    said = refused("build", "silkk", "--out", "a.zarr")
    assert "silkk is neither a file nor a recipe" in said and "linen" in said
    (tmp_path / "linen").write_text(SOLID)  # what lies there goes before
    assert recipe_place("linen").read_text() == SOLID


def test_a_scene_names_a_shipped_recipe(tmp_path):
    """Its own file of that name would go before; the sphere of solid.toml is loaded."""
    (tmp_path / "scene.toml").write_text(camera((8, 8), 20.0) + KEY + '\n[[box]]\nrecipe = "solid"\n')
    assert load_scene(tmp_path / "scene.toml")[0].boxes[0].bricks.kept > 0


def test_recipes_are_listed_and_printed(capsys):
    assert main(["recipes"]) == 0
    assert capsys.readouterr().out.count("\n") == len(shipped_recipes())
    assert main(["recipes", "--name", "skin"]) == 0
    assert capsys.readouterr().out == shipped_recipes()["skin"].read_text(encoding="utf-8")


def test_messages_are_as_many_as_asked_for(tmp_path, capsys):
    (tmp_path / "solid.toml").write_text(SOLID)
    command = ["build", str(tmp_path / "solid.toml"), "--force", "--out", str(tmp_path / "a.zarr")]
    said = {}
    for how in ("--quiet", "--verbose", ""):
        assert main([*command, *filter(None, [how])]) == 0
        said[how] = capsys.readouterr()
    assert said["--quiet"].err == "" and "wrote" not in said["--quiet"].out and "wrote" in said[""].out
    assert " s: building " in said["--verbose"].err and said[""].err == ""
    assert logging.getLogger("hagoromo").level == logging.NOTSET and not logging.getLogger("hagoromo").handlers
    assert main([*command, "--quiet", "--verbose"]) == 2
    assert "contradict" in capsys.readouterr().err


def test_words_behind_two_dashes_are_the_command_s_own():
    assert taken(["info", "--", "--quiet"]) == (["info", "--", "--quiet"], taken([])[1])


def test_verbose_says_each_step_of_a_long_command(capsys):
    for options, expected in ((Everywhere(), 0), (Everywhere(level=logging.DEBUG), 2)):
        with everywhere(options), progress_bar("render") as progress:
            for step in ("first", "second", "third"):
                progress(0.5, step)
        assert capsys.readouterr().err.count(" took ") == expected
