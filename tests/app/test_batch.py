"""A batch does what changed and no more, goes on past what fails, and says so in one table."""

import os

import pytest

import hagoromo as hg
from hagoromo.app.batch import batch as batches
from hagoromo.app.batch.batch import Ledger
from hagoromo.app.batch.batch_file import read_batch
from hagoromo.app.batch.table import Outcome
from hagoromo.app.cli import main

RECIPE = """
each = "scenes/*.toml"

[[step]]
name = "rendered"
verb = "render"
arguments = ["{path}"]
options = { tolerance = 0.05, separate-lamps = true }
out = "pictures/{name}.exr"

[[step]]
name = "dimmed"
verb = "expose"
arguments = ["{rendered}"]
options = { strength = ["key=0.5", "fill=2"] }
out = "dimmed/{name}.exr"
"""


@pytest.fixture
def home(scene, tmp_path):
    """A folder with a batch over three scenes, of which one, when `spoil` is set, has no lamps."""
    text = scene("size = [61, 47]", "size = [13, 11]").read_text()
    (tmp_path / "scenes").mkdir()
    for name in ("a", "b", "c"):
        (tmp_path / "scenes" / f"{name}.toml").write_text(text)
    (tmp_path / "batch.toml").write_text(RECIPE)
    return tmp_path


@pytest.fixture
def run(home, capsys):
    """Run the batch; its exit status, its table, and step → what became of it."""

    def run_batch(*options, recipe=home / "batch.toml"):
        capsys.readouterr()
        status = main(["batch", str(recipe), "--out", str(home / "out"), *options])
        said = capsys.readouterr()
        return status, said.out.splitlines(), said.err

    return run_batch


def states(outcomes: tuple[Outcome, ...]) -> dict[str, str]:
    return {one.step: one.state for one in outcomes}


def test_a_rerun_does_only_what_changed(home, run):
    assert run("--dry-run")[1][-1] == "6 of 6 steps would run, 0 are unchanged"
    assert not (home / "out").exists()
    status, lines, _ = run()
    assert (status, lines) == (0, ["6 steps: 6 done"])
    dimmed = hg.read_image(home / "out" / "dimmed" / "b.exr")
    assert dimmed.weights.max() > 0
    ledger = home / "out" / ".batch"
    (ledger / ".contents.json.lock").touch()  # left by a run that was killed
    (ledger / "38" / ".38f0.json.writing").mkdir(parents=True)
    (ledger / "38" / ".38f0.json.writing" / ".hagoromo").touch()
    assert run()[1] == ["6 steps: 6 unchanged"]
    assert not [left for left in ledger.rglob("*") if left.name.startswith(".")]

    changed = home / "scenes" / "b.toml"
    changed.write_text(changed.read_text().replace("beta = 0.5", "beta = 0.4"))
    os.utime(home / "scenes" / "a.toml", ns=(1, 1))  # touched: its content is as it was
    assert run("--dry-run")[1][-1] == "2 of 6 steps would run, 4 are unchanged"
    assert run()[1] == ["6 steps: 2 done, 4 unchanged"]

    (home / "out" / "dimmed" / "c.exr").unlink()
    (home / "out" / "pictures" / "a.png").write_bytes(b"")
    assert run("--dry-run")[1] == [
        "rendered a  would run", "dimmed a    would run", "rendered b  unchanged", "dimmed b    unchanged",
        "rendered c  unchanged", "dimmed c    would run", "3 of 6 steps would run, 3 are unchanged",
    ]  # fmt: skip
    assert run()[1] == ["6 steps: 3 done, 3 unchanged"]

    recipe = (home / "batch.toml").read_text()
    (home / "batch.toml").write_text(recipe.replace("key=0.5", "key=0.25"))
    assert run()[1] == ["6 steps: 3 done, 3 unchanged"]


def test_a_step_that_fails_is_in_the_table_and_the_others_go_on(home, run):
    spoilt = home / "scenes" / "b.toml"
    whole = spoilt.read_text()
    spoilt.write_text(whole.replace("gamma = 0.2", "gamma = -0.2"))
    status, lines, said = run()
    assert status == 2 and said == ""
    assert lines[0].startswith("rendered b  failed") and "b.toml" in lines[0] and "gamma" in lines[0]
    assert lines[1] == "dimmed b    not run    it needs the result of rendered b"
    assert lines[2:] == ["6 steps: 4 done, 1 failed, 1 not run"]
    spoilt.write_text(whole)
    status, lines, _ = run()
    assert (status, lines) == (0, ["6 steps: 2 done, 4 unchanged"])


def test_a_bug_in_one_step_is_a_failed_step(home, monkeypatch):
    def broken(call):
        raise ZeroDivisionError("of a bug")

    monkeypatch.setattr("hagoromo.app.cli.carry_out", broken)
    outcomes = hg.batch(home / "batch.toml", home / "out")
    assert set(states(outcomes).values()) == {"failed", "not run"}
    assert outcomes[0].said == "ZeroDivisionError: of a bug"


def test_a_run_that_was_killed_is_taken_up_again(home, monkeypatch):
    """After the fourth of six steps: results that are there are kept, the one under way is made again."""
    ran, done = [], Ledger.done

    def killed(self, step, key):
        ran.append(step.out)
        if len(ran) == 4:
            raise KeyboardInterrupt
        done(self, step, key)

    monkeypatch.setattr(Ledger, "done", killed)
    with pytest.raises(KeyboardInterrupt):
        hg.batch(home / "batch.toml", home / "out")
    assert ran[3].exists()
    monkeypatch.setattr(Ledger, "done", done)
    again = states(hg.batch(home / "batch.toml", home / "out"))
    assert sorted(again.values()) == ["done"] * 3 + ["unchanged"] * 3


def test_files_of_somebody_else_are_kept(home, run):
    own = home / "out" / "pictures" / "b.exr"
    own.parent.mkdir(parents=True)
    own.write_text("mine")
    status, lines, said = run()
    assert status == 2 and "b.exr exists and no batch made it" in said and said.count("\n") == 1 and lines == []
    assert own.read_text() == "mine" and not (home / "out" / "pictures" / "a.exr").exists()
    assert run("--force")[0] == 0


def test_a_result_that_a_scene_names_is_made_first(home, recipe, run):
    """The box is named by the scene, not by the batch: the step that renders the scene needs the one that builds it."""
    (home / "out").mkdir()
    (home / "skin.toml").write_text(recipe.replace("size_mm = 6.0", "size_mm = 2.0\nvoxel_mm = 0.1"))
    boxed = (home / "scenes" / "a.toml").read_text() + '\n[[box]]\nfile = "out/skin.zarr"\n'
    (home / "boxed.toml").write_text(boxed)
    (home / "boxed_batch.toml").write_text("""
[[step]]
name = "box"
verb = "build"
arguments = ["skin.toml"]
out = "skin.zarr"
[[step]]
name = "picture"
verb = "render"
arguments = ["boxed.toml"]
out = "boxed.exr"
""")
    steps = read_batch(home / "boxed_batch.toml", home / "out")
    assert [step.name for step in steps] == ["box", "picture"] and steps[1].needs == (0,)
    status, lines, _ = run(recipe=home / "boxed_batch.toml")
    assert (status, lines) == (0, ["2 steps: 2 done"])
    assert run(recipe=home / "boxed_batch.toml")[1] == ["2 steps: 2 unchanged"]
    (home / "skin.toml").write_text((home / "skin.toml").read_text().replace("alpha = 0.2", "alpha = 0.3"))
    assert run(recipe=home / "boxed_batch.toml")[1] == ["2 steps: 2 done"]


@pytest.mark.nightly
def test_steps_under_way_are_bounded_by_the_workers(tmp_path):
    """Two thousand captures of two steps: eight are under way at any time, each when what it needs is done."""
    for number in range(2_000):
        (tmp_path / "captures" / f"{number:05}").mkdir(parents=True)
    (tmp_path / "batch.toml").write_text("""
each = "captures/*"
[[step]]
name = "measured"
verb = "measure"
arguments = ["{path}"]
out = "measured/{name}"
[[step]]
name = "relit"
verb = "relight"
arguments = ["{path}"]
options = {against = "{measured}"}
out = "relit/{name}"
""")
    steps = read_batch(tmp_path / "batch.toml", tmp_path / "out")
    assert len(steps) == 4_000 and steps[3_999].needs == (3_998,)
    run, sent = batches._Run(steps, [""] * len(steps), set()), []
    ready = run.ready(Ledger(str(tmp_path)))
    for number in range(len(steps)):
        while len(sent) < 8 and (arguments := next(ready, None)) is not None:
            assert all(run.known[arguments[1].needs[0]].state == "done" for _ in arguments[1].needs)
            sent.append(arguments[1])
        step = sent.pop(0)
        run.finish(number, Outcome(step.name, step.out, "done"))
    assert states(tuple(run.outcomes())) == dict.fromkeys((step.name for step in steps), "done")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('each = "scenes/*.toml"', 'each = "../*"', "give a pattern inside the folder"),
        ('each = "scenes/*.toml"', 'each = "/etc/*"', "give a pattern inside the folder"),
        ('each = "scenes/*.toml"', 'each = "none/*"', "matches nothing"),
        ('each = "scenes/*.toml"', "", "give a pattern inside the folder"),
        ('verb = "render"', 'verb = "batch"', "verb"),
        ('verb = "render"', 'verb = "rm"', "verb"),
        ('arguments = ["{path}"]', 'arguments = ["{capture}"]', "uses {capture}: known are path, name"),
        ('arguments = ["{path}"]', 'arguments = ["{dimmed}"]', "uses {dimmed}"),
        ('arguments = ["{path}"]', 'arguments = ["../../secret.toml"]', "points outside"),
        ('out = "pictures/{name}.exr"', 'out = "../{name}.exr"', "points outside"),
        ('out = "pictures/{name}.exr"', 'out = "picture.exr"', "write {name} in it"),
        ('out = "dimmed/{name}.exr"', 'out = "pictures/{name}.exr"', "rendered a would both write pictures/a.exr"),
        ('name = "dimmed"', 'name = "rendered"', "the name is taken"),
        ('name = "dimmed"', 'name = "Dimmed"', "must be a text of the form ^[a-z][a-z0-9_]{0,63}$: given 'Dimmed'"),
        ('name = "rendered"', 'name = "path"', "the name is taken"),
        ("tolerance = 0.05", "force = true", "has the option 'force'"),
        ("tolerance = 0.05", "tolerance = {}", "give text, a number, true or a list"),
        ("tolerance = 0.05", '"x --out y" = 1', "has the option 'x --out y'"),
    ],
)
def test_a_recipe_that_is_none_is_refused_in_one_line(home, run, old, new, said):
    assert old in RECIPE
    (home / "batch.toml").write_text(RECIPE.replace(old, new, 1))
    status, lines, error = run()
    assert status == 2 and lines == [] and error.count("\n") == 1 and said in error and "batch.toml" in error
    assert not (home / "out").exists()
