"""Recipes of batches with words of an attacker among their arguments; they run, and must not leave their folder.

The judge of that is the interpreter, which reports what is opened, made, renamed and connected to: nothing beside the
folder of the recipe, in which the results lie, too, may be touched, nobody called, and no program begun.
"""

from __future__ import annotations

import contextlib
import os
import sys
import tomllib
from pathlib import Path
from typing import Any

import numpy as np

from fuzz import pictures, records
from fuzz.trees import spoilt_toml, toml_text
from fuzz.verbs import options

Random = np.random.Generator
BATCH = """
each = "cameras/*.json"

[[step]]
name = "model"
verb = "convert"
arguments = ["{path}"]
options = { to = "colmap" }
out = "models/{name}"

[[step]]
name = "box"
verb = "convert"
arguments = ["a.npy", "--scale", "1", "--material", "m.toml"]
out = "a.zarr"

[[step]]
name = "dimmed"
verb = "expose"
arguments = ["a.exr"]
options = { strength = "key=0.5", spectrum = ["key=lamp.csv", "fill=A"] }
out = "b.exr"
"""
MATERIAL = "[material]\nalpha = 0.2\nbeta = 0.1\ngamma = 0.2\nn = 1.5\nbody_colour = 0.8\n"
OUTSIDE = "@OUTSIDE@"  # stands for the folder beside that of the recipe
SECRETS = {"secret.toml": MATERIAL, "secret.csv": "wavelength_nm,value\n400,1\n700,1\n", "out.exr": "mine"}
PLACES = (
    "../outside/secret.toml", "../outside/secret.csv", f"{OUTSIDE}/secret.toml", f"{OUTSIDE}/secret.csv", "link.toml",
    "link.csv", "links/secret.toml", "here.toml", "here.csv", "../elsewhere/here.toml", "secret.toml", "/etc/passwd",
    "cameras/../../outside/secret.csv", "{box}/../../../outside/secret.toml", "{path}/../../../outside/secret.csv",
    "{model}/../../../../outside/secret.toml", f"{OUTSIDE}/out.exr", "../outside/out.exr", "file:///etc/passwd",
    "/dev/zero", "~/.profile", "$HOME", "a.npy", "m.toml", "lamp.csv", ".", "..", "", "\0", "x" * 300,
)  # fmt: skip
ADDRESSES = ("tcp://127.0.0.1:9", "tls://127.0.0.1:9", "1", "local", "http://127.0.0.1:9", "inproc://x")
OWN = ("out", "force", "scheduler", "trust-scheduler", "allow", "verbose", "quiet", "help", "h", "version",
       "tyro-write-completion", "tyro-print-completion")  # fmt: skip
NAMED = ("key={}", "fill=key={}", "={}", "{}=a")
CHANGES = ("os.mkdir", "os.rename", "os.remove", "os.rmdir", "os.link", "os.symlink", "os.truncate", "os.listdir",
           "os.scandir", "os.chmod", "os.utime")  # fmt: skip
CALLS = ("socket.connect", "socket.bind", "socket.getaddrinfo", "subprocess.Popen", "os.system", "os.exec", "os.fork",
         "os.posix_spawn")  # fmt: skip
_watched: dict[str, Any] = {}  # "apart": a folder; "home": what may be touched in it; "met": what else was


def write(folder: Path) -> None:
    """A recipe of three kinds of steps, with what they read, and links that lead outside."""
    (folder / "batch.toml").write_text(BATCH)
    (folder / "cameras").mkdir()
    records.camera(folder / "cameras" / "a.json")
    np.save(folder / "a.npy", np.ones((4, 5, 6), np.float32))
    (folder / "m.toml").write_text(MATERIAL)
    (folder / "lamp.csv").write_text(SECRETS["secret.csv"])
    pictures.rendered(folder / "a.exr")


def read(path: Path) -> Any:
    """Run the batch; AssertionError for what it touches outside its folder."""
    from hagoromo.app.batch.batch import batch

    home, apart = path.parent, path.parent.parent
    _make_outside(apart, home)
    path.write_bytes(path.read_bytes().replace(OUTSIDE.encode(), str(apart / "outside").encode()))
    with contextlib.chdir(apart / "elsewhere"), _watching(apart, home) as met:
        found = batch(path, home / "out", force=True)
    if met:
        raise AssertionError(f"it left its folder: {met[:3]}")
    return found


def spoil(files: dict[str, bytes], random: Random) -> None:
    """One to three steps with words of an attacker; now and then another thing wrong with the recipe."""
    tree = tomllib.loads(files["batch.toml"].decode())
    for _ in range(int(random.choice((1, 1, 2, 3)))):
        step = tree["step"][int(random.integers(len(tree["step"])))]
        act = random.random()
        words = _attack(step["verb"], random)
        if act < 0.6:
            at = int(random.integers(len(step["arguments"]) + 1))
            step["arguments"][at : at + int(random.integers(2))] = words
        elif act < 0.85:
            key = _one((*OWN, *(name for name, _ in options(step["verb"]))), random)
            step.setdefault("options", {})[key] = words if random.random() < 0.5 else _one((words[-1], True, 1), random)
        elif act < 0.95:
            step["out"] = _one(PLACES, random)
        else:
            tree["each"] = _one(PLACES, random)
    data = toml_text(tree)
    files["batch.toml"] = spoilt_toml(data, random) if random.random() < 0.1 else data


def _attack(verb: str, random: Random) -> list[str]:
    """Words that name an option, or a file, in one of the ways in which a parser may take them."""
    name = _one(OWN if random.random() < 0.4 else tuple(name for name, _ in options(verb)), random)
    value = _one(ADDRESSES if name in ("scheduler", "trust-scheduler") else PLACES, random)
    if random.random() < 0.3:
        value = _one(NAMED, random).format(value)
    short = name[: int(random.integers(1, len(name) + 1))]
    forms = (
        [f"--{name}={value}"], [f"--{name}={value}"], [f"--{name}", value], [f"--{name}", value], [f"--{name}"],
        [f"-{name}", value], [f"--{short}={value}"], [f"--{short}", value], [f"-{short}", value], [value],
        [f"{name}={value}"], ["--", value], ["--", f"--{name}={value}"], [f"--{name.replace('-', '_')}={value}"],
        [f"--{name.upper()}={value}"], [f"--{name}", "=", value], [f"--{name} {value}"], [f"--no-{name}"],
    )  # fmt: skip
    return list(forms[int(random.integers(len(forms)))])


def _one(choices: tuple, random: Random) -> Any:
    return choices[int(random.integers(len(choices)))]


def _make_outside(apart: Path, home: Path) -> None:
    """What the recipe must not reach: beside its folder, where the command runs, and behind links."""
    for folder, names in (("outside", SECRETS), ("elsewhere", {"here.toml": MATERIAL, "here.csv": "a,b\n1,2\n"})):
        (apart / folder).mkdir(exist_ok=True)
        for name, text in names.items():
            (apart / folder / name).write_text(text)
    for link, target in (("link.toml", "secret.toml"), ("link.csv", "secret.csv"), ("links", "")):
        if not os.path.lexists(home / link):
            (home / link).symlink_to(apart / "outside" / target)


@contextlib.contextmanager
def _watching(apart: Path, home: Path) -> Any:
    """Gives the list of what is touched in the folder `apart`, but for `home`, and of calls, while the block runs."""
    if "hook" not in _watched:
        sys.addaudithook(_heard)  # for ever: hooks cannot be taken back
        _watched["hook"] = True
    met: list[str] = []
    _watched.update(apart=os.path.realpath(apart), home=os.path.realpath(home), met=met)
    try:
        yield met
    finally:
        _watched["met"] = None


def _heard(event: str, given: tuple[Any, ...]) -> None:
    met = _watched.get("met")
    if met is None or not (event == "open" or event in CHANGES or event in CALLS):
        return
    if event in CALLS:
        met.append(event)
        return
    of_folder = event in CHANGES and isinstance(given[-1], int) and given[-1] >= 0  # by a number: not known here
    for place in given[: 2 if event in ("os.rename", "os.link") else 1]:
        if isinstance(place, (str, bytes, os.PathLike)) and (os.path.isabs(place) or not of_folder):
            real = os.path.realpath(os.fsdecode(place))
            inside = f"{real}{os.sep}".startswith(f"{_watched['home']}{os.sep}")
            if real.startswith(f"{_watched['apart']}{os.sep}") and not inside:
                met.append(f"{event} {place!r}")
