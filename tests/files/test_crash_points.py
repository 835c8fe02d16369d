"""Commands that are killed at each file operation, or whose disk is full, leave the old target or the new one."""

import inspect
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("resource", reason="the limits on files are POSIX's")
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize(
    "fault",
    [
        pytest.param(("--verbs", "convert to COLMAP"), marks=pytest.mark.nightly),
        ("--full", "--verbs", "expose"),
    ],
)
def test_a_command_that_is_cut_off_leaves_the_old_or_the_new(fault):
    """A folder, and an EXR with its PNG, at 4 points each; all verbs and points: `make crash`."""
    ended = subprocess.run(
        [sys.executable, "-m", "fuzz.crash", "--most", "4", *fault],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "unclean    0" in ended.stdout.splitlines()[-1]


def test_every_command_that_writes_is_swept():
    from fuzz.crash_cases import CASES
    from fuzz.verbs import function_of
    from hagoromo.app import cli

    assert cli.main  # with it, all modules that have commands are loaded
    modules = [module for name, module in sys.modules.items() if name.startswith("hagoromo.app.")]
    functions = [one for module in modules for one in vars(module).values() if inspect.isfunction(one)]
    writing = {one.__name__ for one in functions if "Out" in str(inspect.signature(one).parameters.get("out"))}
    assert "simulate" in writing and writing <= {function_of(case) for case in CASES}
