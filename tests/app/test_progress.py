"""Progress: parts of the work in terms of the whole, and lines where there is no terminal."""

import pytest

from hagoromo.app.progress_bar import LIVE_PAUSE_S, PAUSE_S, QUIET_S, progress_lines, time_left
from hagoromo.progress import part_of, silent


class Clock:
    """Stands still until it is set."""

    seconds = 0.0

    def __call__(self) -> float:
        return self.seconds


def test_a_part_of_a_part_runs_over_its_share_of_the_whole():
    calls = []
    whole = part_of(lambda share, step="": calls.append((share, step)), 0.2, 0.6, "measurement")
    half = part_of(whole, 0.5, 0.5, "residuals")
    half(0.0)
    half(1.0, "lamp 3")
    assert calls[0] == (pytest.approx(0.5), "measurement: residuals")
    assert calls[1] == (pytest.approx(0.8), "measurement: residuals: lamp 3")


def test_a_part_of_silence_is_silent():
    assert part_of(silent, 0.0, 0.5, "normals") is silent


def test_a_program_that_reads_along_gets_a_line_for_each_hundredth_from_the_start(capsys):
    clock = Clock()
    progress = progress_lines("measure", clock, live=True)
    for share in (0.0, 0.001, 0.02, 0.04):
        progress(share, "normals")
        clock.seconds += 1.25 * LIVE_PAUSE_S
    progress(0.06, "normals")
    progress(0.08, "normals")
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == [f"measure: {k} %" for k in (0, 2, 4, 6)]


def test_without_a_terminal_long_work_writes_a_line_per_tenth_or_step(capsys):
    clock = Clock()
    progress = progress_lines("measure", clock)
    progress(0.05, "normals")
    clock.seconds = QUIET_S - 1.0
    progress(0.1, "normals")
    assert capsys.readouterr().err == ""  # short work, and bad input, write no lines
    clock.seconds = QUIET_S
    progress(0.2, "normals")
    progress(0.5, "materials")  # too soon after the last line
    clock.seconds += PAUSE_S
    progress(0.25, "normals")  # neither a tenth further nor a new step
    progress(0.26, "materials")
    clock.seconds += PAUSE_S
    progress(1.0)
    assert capsys.readouterr().err == (
        "measure: 20 %, normals, about 2 min left\nmeasure: 26 %, materials, about 114 s left\nmeasure: 100 %\n"
    )


def test_the_time_that_is_left_follows_the_share_that_is_done():
    assert time_left(0.25, 60.0) == "about 3 min left"
    assert time_left(0.5, 90.0) == "about 90 s left"
    assert time_left(0.1, 3600.0) == "about 9 hours left" and time_left(0.02, 86400.0) == "about 49 days left"
    assert time_left(0.01, 60.0) == "" == time_left(1.0, 60.0)
