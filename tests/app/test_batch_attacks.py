"""A recipe of a stranger runs our commands on its own files, and nothing else; steps do not write over one another."""

import json
import os
import pickle
import types
import typing
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

import numpy as np
import pytest

import hagoromo as hg
from fuzz.crash_cases import CASES
from fuzz.verbs import function_of, options
from hagoromo.app import cli
from hagoromo.app.batch.batch_file import read_batch
from hagoromo.app.batch.batch_record import VERBS
from hagoromo.app.shared_options import LookOptions, SchedulerOptions, SensorOptions
from hagoromo.app.verb import written_by_verb
from hagoromo.app.views_options import ViewsOptions
from hagoromo.errors import InputError
from hagoromo.files import content as content_module
from hagoromo.files.table import write_table

COMMANDS = {function_of(case): case for case in reversed(CASES) if case.words[0] in VERBS}
FOLDER = "x"  # result of a step that makes a folder


@pytest.fixture
def home(tmp_path, monkeypatch):
    """The folder of a recipe; beside it lies what it must not reach, and the command runs elsewhere."""
    for folder in ("recipe", "elsewhere"):
        (tmp_path / folder).mkdir()
    (tmp_path / "secret.toml").write_text("a = 1\n")
    (tmp_path / "recipe" / "link.toml").symlink_to(tmp_path / "secret.toml")
    (tmp_path / "elsewhere" / "here.toml").write_text("a = 1\n")
    monkeypatch.chdir(tmp_path / "elsewhere")
    return tmp_path / "recipe"


def recipe(home: Path, *steps: dict[str, Any], each: str = "") -> Path:
    """A recipe of steps, each with a name of its own; words: a list of verb and arguments."""
    lines = [f"each = {json.dumps(each)}"] if each else []
    for number, step in enumerate(steps):
        verb, *arguments = step["words"]
        lines += ["[[step]]", f'name = "s{number}"', f"verb = {json.dumps(verb)}"]
        lines += [f"arguments = {json.dumps(arguments, ensure_ascii=False)}", f"out = {json.dumps(step['out'])}"]
        lines += [f"options = {{{step['options']}}}"] if "options" in step else []
    (home / "batch.toml").write_text("\n".join(lines))
    return home / "batch.toml"


def planned(home: Path, *steps: dict[str, Any], each: str = "") -> list[Any]:
    return read_batch(recipe(home, *steps, each=each), home.parent / "out")


def words_of(function: str) -> list[str]:
    """Words by which a command is parsed, without --out."""
    return list(COMMANDS[function].words)


def out_of(function: str) -> str:
    return COMMANDS[function].targets[0]


@pytest.mark.parametrize("function", COMMANDS)
def test_what_is_the_users_is_refused_from_a_recipe_to_every_command(home, function):
    good = {"words": words_of(function), "out": out_of(function)}
    assert len(planned(home, good)) == 1
    for more, said in (("--out=y", "it has --out"), ("--force", "it has --force")):
        with pytest.raises(InputError, match=said):
            planned(home, good | {"words": [*good["words"], more]})


@pytest.mark.parametrize(
    "more",
    [
        ["--out", "y"], ["--ou=y"], ["-out", "y"], ["--OUT=y"], ["--out="], ["--forc"], ["-force"], ["-f"],
        ["--force=True"], ["--no-force"], ["--allow", "/"], ["--allo=/"], ["-allow", "/"], ["--allow="], ["--verbose"],
        ["--quiet"], ["--help"], ["-h"], ["--version"], ["--tyro-write-completion", "bash", "y"], ["--", "--force"],
        ["--tyro-print-completion", "bash"], ["--", "--out", "y"], ["--samples"], ["--display", "--out", "y"],
        ["--samples", "1", "--force"], ["--out", "the result of a step", "--out=y"],
    ],
)  # fmt: skip
def test_no_spelling_of_it_is_taken(home, more, capsys):
    with pytest.raises(InputError):
        planned(home, {"words": ["render", "a.toml", *more], "out": "a.exr"})
    assert capsys.readouterr() == ("", "") and sorted(home.iterdir()) == [home / "batch.toml", home / "link.toml"]


def test_a_text_that_looks_like_it_is_a_text(home):
    (step,) = planned(home, {"words": ["render", "a.toml", "--display=--out"], "out": "a.exr"})
    assert step.call.values["look"].display == "--out"


def test_a_configuration_of_colours_lies_in_the_folder(home):
    for value in ("../secret.toml", "link.toml", str(home.parent / "secret.toml")):
        with pytest.raises(InputError, match=r"points outside|is a link that leads outside"):
            planned(home, {"words": ["render", "a.toml", f"--ocio={value}"], "out": "a.exr"})


@pytest.mark.parametrize("key", ["out", "force", "scheduler", "trust-scheduler", "allow", "verbose"])
def test_options_of_the_user_are_refused_by_name(home, key):
    with pytest.raises(InputError, match=f"has the option '{key}'"):
        planned(home, {"words": ["render", "a.toml"], "out": "a.exr", "options": f'{key} = "1"'})


PATHS = [
    (function, name, "Path" in kind)
    for function in COMMANDS
    for name, kind in options(function)
    if "Path" in kind or "str" in kind.replace("strength", "").lower()
]


def with_option(function: str, name: str, value: str) -> list[str]:
    """The words of a command with an option of that value, in the place of one that it has."""
    words = words_of(function)
    if f"--{name}" in words:
        at = words.index(f"--{name}")
        words[at : at + 2] = []
    return [*words, f"--{name}={value}"]


@pytest.mark.parametrize(("function", "name", "is_path"), PATHS)
def test_every_file_of_every_command_lies_in_the_folder(home, function, name, is_path):
    """As the only word of an option; by its absolute path, by .., by a link, and behind NAME=."""
    secret = home.parent / "secret.toml"
    for value in ("../secret.toml", "link.toml" if is_path else f"a=b={secret}"):
        with pytest.raises(InputError, match=r"points outside|is a link that leads outside"):
            planned(home, {"words": with_option(function, name, value), "out": out_of(function)})


@pytest.mark.parametrize("function", COMMANDS)
def test_the_files_that_every_command_begins_with_lie_in_the_folder(home, function):
    words = words_of(function)
    first = 2 if function.startswith("calibrate") else 1
    for value in (str(home.parent / "secret.toml"), "a/../../secret.toml"):
        with pytest.raises(InputError, match=r"points outside"):
            planned(home, {"words": [*words[:first], value, *words[first + 1 :]], "out": out_of(function)})


def leaves(kind: Any) -> set[Any]:
    """The types that a value of an annotation is made of."""
    kind = kind.__value__ if hasattr(kind, "__value__") else kind
    if get_origin(kind) is Literal:
        return {str}
    if get_origin(kind) in (typing.Annotated,):
        return leaves(get_args(kind)[0])
    parts = [part for part in get_args(kind) if part is not Ellipsis]
    return set().union(*map(leaves, parts)) if parts or get_origin(kind) is types.UnionType else {kind}


def test_the_types_of_all_values_are_known():
    """A new type of an option has to say whether it names a file, or a recipe that has it is refused."""
    records = SensorOptions, SchedulerOptions, ViewsOptions, LookOptions
    known = {Path, str, int, float, bool, type(None), *records}
    for function in COMMANDS:
        hints = typing.get_type_hints(cli.parsed([*words_of(function), "--out", "x"]).args[0], include_extras=True)
        found = set().union(*(leaves(hint) for name, hint in hints.items() if name != "return"))
        assert found <= known, function
    fields = [hint for record in records for hint in typing.get_type_hints(record).values()]
    assert set().union(*map(leaves, fields)) <= known


def test_a_dataset_in_a_file_that_is_a_link_is_refused(home):
    (home / "scan.h5").symlink_to(home.parent / "secret.toml")
    with pytest.raises(InputError, match="leads outside"):
        planned(home, {"words": ["convert", "scan.h5:density", "--scale", "1"], "out": "a.zarr"})


@pytest.mark.parametrize("text", ["{s0}/../../secret.toml", "{s0}/../../../etc/passwd", "/{s0}/../../secret.toml"])
def test_a_result_is_no_way_out(home, text):
    first = {"words": ["convert", "a.npy"], "out": "a.zarr"}
    steps = planned(home, first, {"words": ["convert", "a.npy", "--material", "{s0}/zarr.json"], "out": "b.zarr"})
    assert steps[1].needs == (0,) and steps[1].call.values["material"] == home.parent / "out" / "a.zarr" / "zarr.json"
    with pytest.raises(InputError, match="points outside"):
        planned(home, first, {"words": ["convert", "a.npy", "--material", text], "out": "b.zarr"})


@pytest.mark.parametrize("name", ["--force", "--out=x", "--scheduler=1", "--allow=.", "-h", "{s0}", "a=b", "=", "é ü"])
def test_the_name_of_a_file_is_no_option(home, name):
    """Of a match: the value of its step, whatever it is called; as a word by itself, too."""
    for folder in ("captures", "."):
        (home / folder / name).mkdir(parents=True)
    steps = planned(home, {"words": ["measure", "{path}"], "out": "m/{name}"}, each="captures/*")
    assert [step.call.values["capture"] for step in steps] == [home / "captures" / name]
    others = planned(
        home,
        {"words": ["relight", "{path}", "--hold", "{name}"], "out": "a/{name}"},
        {"words": ["build", "{name}"], "out": "b/{name}"},
        each=f"{name}*",
    )
    assert [step.call.values.get("hold", step.call.values.get("recipe")) for step in others] == [(name,), home / name]
    assert not any(
        "force" in step.call.values or step.call.values.get("scheduler", cli.HERE) != cli.HERE for step in others
    )


def test_a_match_may_stand_for_a_number(home):
    """Then the words of each match are parsed, and a name that is an option of the user is refused, too."""
    for name in ("7", "12"):
        (home / f"{name}.toml").touch()
    words = ["render", "{path}", "--seed", "{name}"]
    steps = planned(home, {"words": words, "out": "{name}.exr"}, each="[0-9]*.toml")
    assert {step.call.values["seed"] for step in steps} == {7, 12}
    with pytest.raises(InputError, match="'x'"):
        (home / "x.toml").touch()
        planned(home, {"words": words, "out": "{name}.exr"}, each="x.toml")
    (home / "--force").touch()
    with pytest.raises(InputError, match="--seed"):
        planned(home, {"words": ["render", "a.toml", "{name}", "--seed", "{name}"], "out": "{name}.exr"}, each="--*")


def test_what_lies_where_the_command_runs_is_not_read(home, capsys):
    """A name that the recipe's folder does not have; and the command runs there again afterwards."""
    np.save(home / "a.npy", np.ones((4, 5, 6), np.float32))
    write_table(Path("here.csv"), {"wavelength_nm": [400, 700], "value": [1, 1]})
    Path("here.toml").write_text("[material]\nalpha=0.2\nbeta=0.1\ngamma=0.2\nn=1.5\nbody_colour=0.8\n")
    file = recipe(home, {"words": ["convert", "a.npy", "--scale", "1", "--material", "here.toml"], "out": "b.zarr"})
    (outcome,) = hg.batch(file, home.parent / "out")
    assert outcome.state == "failed" and "here.toml does not exist" in outcome.said
    Path("here.toml").rename(home / "here.toml")
    assert [one.state for one in hg.batch(file, home.parent / "out")] == ["done"]
    assert Path.cwd() == home.parent / "elsewhere"


def test_a_call_is_sent_to_workers_and_runs_there(home):
    (step,) = planned(home, {"words": ["develop", "a.dng", "--black", "3", "--transfer", "srgb"], "out": "a.exr"})
    sent = pickle.loads(pickle.dumps(step))
    assert sent == step and sent.call.values["sensor"] == SensorOptions(black=3.0, transfer="srgb")
    assert sent.call.to(Path("z")).keywords["out"] == Path("z") and sent.call.to(Path("z")).keywords["force"] is True


CONFLICTS = [
    ((["render", "a.toml"], "x.exr"), (["convert", "b.exr"], "x.png"), "x.png"),
    ((["expose", "a.exr"], "x.exr"), (["render", "a.toml"], "x.hdr"), "x.png"),
    ((["render", "a.toml", "--turntable", "4"], "x.gif"), (["measure", "a"], "x_frames"), "x_frames"),
    (
        (["render", "a.toml", "--turntable", "4"], "x.gif"),
        (["render", "a.toml", "--turntable", "4"], "x.mp4"),
        "x_frames",
    ),
    ((words_of("calibrate_camera"), "x.json"), (["render", "a.toml"], "x.exr"), "x.png"),
    ((words_of("calibrate_response"), "x.csv"), (words_of("calibrate_rig"), "x.json"), "x.json"),
    ((words_of("calibrate_response"), "x.csv"), (["convert", "a.exr"], "x_interval.csv"), "x_interval.csv"),
    ((["measure", "a"], "x"), (["render", "a.toml"], "x/y/a.exr"), "x"),
    ((["render", "a.toml"], "x/y/a.exr"), (["measure", "a"], "x"), "x"),
    ((["render", "a.toml"], "x.exr"), (["convert", "b.exr"], "x.png/y.hdr"), "x.png"),
    ((["convert", "a.toml"], "x.usda"), (["convert", "b.exr"], "x_2_roughness.png"), "x_"),
    ((["render", "a.toml"], "x_2_a.exr"), (["convert", "a.toml"], "x.usdc"), "x_"),
    ((["convert", "a.toml"], "x.usda"), (["convert", "b.toml"], "x.usdc"), "x_"),
    ((["measure", "a"], "x"), (["measure", "b"], "./y/../x"), "x"),
    ((["measure", "a"], "link/x"), (["measure", "b"], "real/x"), "real/x"),
]


@pytest.mark.parametrize(("one", "other", "what"), CONFLICTS)
def test_two_steps_that_write_one_file_are_refused(home, one, other, what):
    out = home.parent / "out"
    (out / "real").mkdir(parents=True)
    (out / "link").symlink_to(out / "real")
    steps = [{"words": words, "out": name} for words, name in (one, other)]
    with pytest.raises(InputError, match=f"s1 and s0 would both write {what}: give one of them another out"):
        planned(home, *steps)


def test_steps_that_write_beside_one_another_are_not_refused(home):
    """In one folder, with one stem, and with names that begin alike."""
    outs = ("x.exr", "y/x.exr", "x.json", "x_1.exr", "x", "xy.exr")
    verbs = (
        ["render", "a.toml"],
        ["render", "a.toml"],
        words_of("calibrate_lamps"),
        ["render", "a.toml"],
        ["measure", "a"],
    )
    steps = [{"words": words, "out": out} for words, out in zip((*verbs, ["expose", "a.exr"]), outs, strict=True)]
    assert len(planned(home, *steps)) == len(steps)


def test_matches_of_one_name_are_told_apart(home):
    for folder in "ab":
        (home / folder).mkdir()
        (home / folder / "same.toml").touch()
    with pytest.raises(InputError, match=r"s0 same and s0 same would both write same\.exr"):
        planned(home, {"words": ["render", "{path}"], "out": "{name}.exr"}, each="*/same.toml")


@pytest.mark.parametrize(
    "out", [".batch/x", ".x.exr.writing/x.exr", "a/.hidden", ".", "", "a/..", "../x", "/x", "x\0y"]
)
def test_results_lie_in_the_folder_of_results_and_are_not_hidden(home, out):
    """Hidden names are those of the ledger, and of what is being written."""
    with pytest.raises(InputError, match=r"no part of which begins with a dot|points outside|is no path|must be"):
        planned(home, {"words": ["measure", "a"], "out": out})


@pytest.mark.parametrize(
    "case", [case for case in CASES if case.name not in ("schema", "batch", "demo")], ids=lambda case: case.name
)
def test_commands_write_what_they_declare(case):
    """The crash run, which knows every file that a command leaves, has the same."""
    function = cli.parsed([*case.words, "--out", "x"]).args[0]
    written = written_by_verb(function, Path(case.targets[0]))
    assert [str(file) for file in written.files] == list(case.targets)


def test_a_picture_of_somebody_else_is_kept(home, scene):
    """It lies where a step would put the picture beside its result."""
    scene("size = [61, 47]", "size = [13, 11]").rename(home / "a.toml")
    file, out = recipe(home, {"words": ["render", "a.toml"], "out": "x.exr"}), home.parent / "out"
    out.mkdir()
    (out / "x.png").write_text("mine")
    with pytest.raises(InputError, match=r"x\.png exists and no batch made it"):
        hg.batch(file, out)
    assert (out / "x.png").read_text() == "mine" and not (out / "x.exr").exists()
    assert [one.state for one in hg.batch(file, out, force=True)] == ["done"]
    (out / "x.png").unlink()
    assert [one.state for one in hg.batch(file, out)] == ["done"] and (out / "x.png").is_file()
    assert [one.state for one in hg.batch(file, out)] == ["unchanged"]


def test_the_folder_that_the_user_allows_may_be_named(home, monkeypatch):
    monkeypatch.setenv("HAGOROMO_ALLOW", str(home.parent))
    secret = home.parent / "secret.toml"
    for value in (str(secret), "../secret.toml", "link.toml"):
        (step,) = planned(home, {"words": ["convert", "a.npy", "--material", value], "out": "a.zarr"})
        assert os.path.samefile(step.call.values["material"], secret) and step.inputs[-1].path.samefile(secret)


def test_the_spectrum_of_a_lamp_is_an_input(home):
    """A file behind NAME= is digested, as those that stand alone are."""
    write_table(home / "lamp.csv", {"wavelength_nm": [400, 700], "value": [1, 1]})
    (step,) = planned(home, {"words": ["expose", "a.exr", "--spectrum", "key=lamp.csv"], "out": "b.exr"})
    assert [(read.label, read.path) for read in step.inputs] == [("lamp.csv", home / "lamp.csv")]


def test_a_link_that_leads_outside_is_not_opened_to_know_whether_it_changed(home, monkeypatch):
    """A step may name the folder that it lies in; what it leads to is known by size and time."""
    opened = []
    of_file = content_module.sha256_of_file
    monkeypatch.setattr(content_module, "sha256_of_file", lambda path: opened.append(path.name) or of_file(path))
    (home / "a.txt").write_text("a")
    (home / "b.txt").symlink_to(home / "a.txt")
    before = content_module.content(home)
    assert "secret.toml" not in opened and "link.toml" not in opened and len(opened) == 2
    (home.parent / "secret.toml").write_text("another text\n")
    assert content_module.content(home) != before
