"""`batch --new` writes a recipe that runs for the objects on a shelf, and says which folders are none and why."""

import shutil

import pytest

import hagoromo as hg
from hagoromo.app.batch.batch_file import read_batch
from hagoromo.app.cli import main
from studies.dome import dome

PHOTOGRAPHS = 5


def photographs(folder, suffix="jpg", count=PHOTOGRAPHS, lamps=""):
    """A folder of files that are only looked at by their names."""
    folder.mkdir(parents=True)
    for number in range(count):
        (folder / f"{number}.{suffix}").touch()
    if lamps:
        (folder / lamps).touch()


def steps(shelf):
    """The words of every step of the recipe on the shelf, by its name."""
    return {step.name: step.says for step in read_batch(shelf / "batch.toml", shelf / "out")}


def test_one_kind_of_objects_gives_three_steps_with_the_lamps_beside_them(tmp_path, capsys):
    shelf = tmp_path / "shelf"
    for name in ("vase 10", "vase 2", "cup[1]"):
        photographs(shelf / name)
    (shelf / "dome.lp").touch()
    assert main(["batch", "--new", str(shelf)]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said == ["photographs, lamps in dome.lp: cup[1], vase 2, vase 10", f"wrote {shelf / 'batch.toml'}"]
    found = steps(shelf)
    assert [name for name in found if name.endswith("vase 2")] == ["captured vase 2", "measured vase 2", "page vase 2"]
    words = ("capture", "cup[1]", "--lamps", "dome.lp", "--mask", "auto", "--transfer", "srgb")
    assert found["captured cup[1]"] == words
    assert len(found) == 9
    assert main(["batch", str(shelf / "batch.toml"), "--out", str(shelf / "results"), "--dry-run"]) == 0


def test_objects_of_other_kinds_have_steps_of_their_own(tmp_path, capsys):
    photographs(tmp_path / "raw", "dng", lamps="a.lp")
    photographs(tmp_path / "ball", "tif")
    photographs(tmp_path / "few", count=3)
    photographs(tmp_path / "two", lamps="a.lp")
    (tmp_path / "two" / "lamps.json").touch()
    photographs(tmp_path / "{name}")
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        (tmp_path / name / "transforms.json").touch()
    assert main(["batch", "--new", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    for name, reason in (("few", "3 photographs: a shape needs 4"), ("two", "keep one"), ("{name}", "rename it")):
        assert f"left out: {name}: " in said and reason in said
    found = steps(tmp_path)
    assert found["measured one"] == ("measure", "one")  # most objects are captures, so they come first
    assert {name.partition(" ")[0] for name in found} == {
        "measured", "page", "captured_2", "measured_2", "page_2", "captured_3", "measured_3", "page_3",
    }  # fmt: skip
    assert found["captured_2 ball"] == ("capture", "ball", "--ball", "auto", "--mask", "auto")
    assert found["captured_3 raw"] == ("capture", "raw", "--lamps", "raw/a.lp", "--mask", "auto")


def test_photographs_of_a_chrome_ball_by_itself_are_no_object_and_give_the_lamps(tmp_path, capsys):
    """The window takes them so, too: a folder of a ball beside the objects."""
    for name in ("vase", "chrome ball"):
        photographs(tmp_path / name)
    assert main(["batch", "--new", str(tmp_path)]) == 0
    said = capsys.readouterr().out
    assert "left out: chrome ball: " in said and "calibrate lamps 'chrome ball'/* --mask auto" in said
    assert [name for name in steps(tmp_path) if "ball" in name] == []
    (tmp_path / "lamps.json").touch()
    assert main(["batch", "--new", str(tmp_path), "--force"]) == 0
    assert "--lamps" in steps(tmp_path)["captured vase"] and "captured chrome ball" not in steps(tmp_path)


def test_a_recipe_that_is_there_is_kept_unless_forced(tmp_path, capsys):
    photographs(tmp_path / "cup", lamps="a.lp")
    (tmp_path / "batch.toml").write_text("mine")
    assert main(["batch", "--new", str(tmp_path)]) == 2
    assert "batch.toml exists" in capsys.readouterr().err and (tmp_path / "batch.toml").read_text() == "mine"
    assert main(["batch", "--new", str(tmp_path), "--force"]) == 0 and steps(tmp_path)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["--new", "empty"], "has no folder with a capture or photographs"),
        (["--new", "cup"], "it is one object itself"),
        (["--new", "absent"], "absent"),
        (["--new", "shelf", "--out", "x"], "omit --out"),
        ([], "batch needs RECIPE.toml and --out FOLDER, or --new FOLDER"),
    ],
)
def test_wrong_use_is_refused_in_one_line(tmp_path, monkeypatch, capsys, given, said):
    (tmp_path / "empty").mkdir()
    photographs(tmp_path / "cup")
    monkeypatch.chdir(tmp_path)
    assert main(["batch", *given]) == 2
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1
    assert not list(tmp_path.rglob("batch.toml"))


@pytest.mark.nightly
@pytest.mark.filterwarnings("ignore:the mask that was found has 2 parts")  # the object and the ball
def test_a_shelf_is_measured_to_its_pages_past_an_object_that_fails(tmp_path, capsys):
    """One folder with a picture that is none; the lamps of the other are those of its .lp."""
    made, shelf = dome(tmp_path / "dome", 10, 96), tmp_path / "shelf"
    for name in ("cup", "jar"):
        shutil.copytree(made / "photographs", shelf / name)
    shutil.copy(made / "dome.lp", shelf)
    (shelf / "jar" / "03.jpg").write_bytes(b"no picture")
    assert main(["batch", "--new", str(shelf)]) == 0
    run = ["batch", str(shelf / "batch.toml"), "--out", str(shelf / "results")]
    capsys.readouterr()
    assert main(run) == 2
    said = capsys.readouterr().out.splitlines()
    assert len(said) == 4 and said[0].startswith("captured jar  failed") and "03.jpg" in said[0]
    assert said[-1] == "6 steps: 3 done, 1 failed, 2 not run"
    assert [page.name for page in (shelf / "results" / "pages").iterdir()] == ["cup.html"]
    capture = hg.load_capture(shelf / "results" / "captures" / "cup")
    assert len(capture.photographs) == 10
    shutil.copy(made / "photographs" / "03.jpg", shelf / "jar")
    assert main(run) == 0 and capsys.readouterr().out.splitlines()[-1] == "6 steps: 3 done, 3 unchanged"


def test_steps_of_two_each_are_not_mixed(tmp_path):
    lines = ['each = "*.toml"', "[[step]]", 'name = "a"', 'verb = "measure"', 'arguments = ["{path}"]']
    lines += ['out = "a/{name}"', "[[step]]", 'name = "b"', 'verb = "measure"', 'each = "*.json"']
    lines += ['arguments = ["{a}"]', 'out = "b/{name}"']
    (tmp_path / "batch.toml").write_text("\n".join(lines))
    with pytest.raises(hg.InputError, match="step 'b' uses results for other files"):
        read_batch(tmp_path / "batch.toml", tmp_path / "out")
    lines[-2] = 'arguments = ["x"]'
    lines[-1] = 'out = "b"'
    (tmp_path / "batch.toml").write_text("\n".join(lines))
    with pytest.raises(hg.InputError, match="step 'b' has each and names neither"):
        read_batch(tmp_path / "batch.toml", tmp_path / "out")
