"""Commands that are killed at each file operation, or whose disk is full, leave the old target or the new one."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("resource", reason="the limits on files are POSIX's")
ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("fault", [("--verbs", "convert to COLMAP", "expose"), ("--full", "--verbs", "expose")])
def test_a_command_that_is_cut_off_leaves_the_old_or_the_new(fault):
    """A folder, and an EXR with its PNG, at 15 points each; all verbs and points: `make crash`."""
    ended = subprocess.run(
        [sys.executable, "-m", "fuzz.crash", "--most", "15", *fault],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert ended.returncode == 0, ended.stdout + ended.stderr
    assert "unclean    0" in ended.stdout.splitlines()[-1]
