"""The simulation of many workers keeps the laws of queues, and its page is made of the record."""

from dataclasses import replace

import pytest

from studies.cluster import CAPTURES, simulated
from studies.cluster_orders import on_paper, steps
from studies.cluster_page import hours, write_cluster_page
from studies.cluster_simulation import Machines, SimulatedWork, simulate

EVEN = SimulatedWork(scenes=40, tasks=1, fetched=0.0, prepare_s=1.0, work_s=9.0, returned=0.0, spread=0.0)
FREE = Machines(1, scheduler_s=0.0, mean_life_s=1e12)
ROW = {
    "workers": 1, "killed": False, "start_s": 2.0, "ready_s": 5.0, "wall_s": 3.0, "prepare_cpu_s": 4.0, "cpu_s": 6.0,
    "client_cpu_s": 0.2, "tiles": 80, "same_bits": True,
}  # fmt: skip
HERE = {
    "rows": [ROW, ROW | {"workers": 2, "killed": True}], "pixels": 1280 * 960, "samples": 4, "cores": 2, "load": 1.0,
    "task": {"count": 2000, "wall_s": 2e-3, "cpu_s": 1e-3},
}  # fmt: skip


FULL_ROW = {"workers": 1, "shared": False, "cpu_s": 9.0, "same_bits": True, "kept_bytes": 0}
FULL = {
    "rows": [FULL_ROW, FULL_ROW | {"shared": True, "cpu_s": 5.0, "kept_bytes": 2_000_000}],
    "cells": 1000, "size": [320, 240], "samples": 1, "load": 1.0,
}  # fmt: skip
PATH_ROW = {"workers": 1, "killed": False, "tasks": 8, "same_bits": True, "prepare_cpu_s": 2.0, "cpu_s": 7.2}
FIGURE = {
    "rows": [PATH_ROW, PATH_ROW | {"workers": 2, "killed": True}], "size": [150, 100], "pixels": 15000, "walks": 48,
    "noise": 0.5, "error": 0.02, "walks_for_error": 24000.0, "whole_pixels": 3_000_000, "whole_size": [1500, 2000],
    "boxes_bytes": 1_000_000, "load": 1.0, "cores": 2,
}  # fmt: skip

OF_MODES = FIGURE | {"walks_for_error": 48000.0, "size": [192, 128]}


@pytest.mark.parametrize("workers", [1, 4, 40, 80])
def test_with_nothing_shared_time_is_work_over_workers(workers):
    assert simulate(EVEN, replace(FREE, workers=workers)).seconds == pytest.approx(400.0 / min(workers, 40))


def test_what_is_shared_bounds_the_time():
    """The scheduler, the store and the client's link, each as the only one that is slow."""
    many = replace(FREE, workers=1000)
    assert simulate(EVEN, replace(many, scheduler_s=5.0)).seconds == pytest.approx(40 * 5.0 + 10.0)
    big = replace(EVEN, fetched=1e9, returned=1e9)
    slow = replace(many, store_bytes_s=1e8, worker_bytes_s=1e9, client_bytes_s=1e30)
    assert simulate(big, slow).seconds == pytest.approx(40 * 10.0 + 10.0)
    result = simulate(big, replace(many, client_bytes_s=1e8, store_bytes_s=1e30, worker_bytes_s=1e30))
    assert result.seconds == pytest.approx(40 * 10.0 + 10.0) and result.bound_by(1000, 40) == "client's link"


def test_a_scene_is_made_ready_once_by_every_worker_that_has_a_task_of_it():
    tiles = replace(EVEN, scenes=3, tasks=8, one_by_one=True)
    assert simulate(tiles, replace(FREE, workers=4)).prepared == 3 * 4
    assert simulate(tiles, FREE).prepared == 3


def test_deaths_cost_time_and_lose_no_task():
    mortal = replace(FREE, workers=4, mean_life_s=60.0)
    result = simulate(EVEN, mortal, seed=1)
    assert result.deaths > 0 and result.seconds > simulate(EVEN, replace(FREE, workers=4)).seconds
    assert result.working == pytest.approx(40 * 9.0 / (result.seconds * 4))
    assert simulate(EVEN, mortal, seed=1) == result != simulate(EVEN, mortal, seed=2)


def test_ten_thousand_captures_are_bounded_by_the_store_in_the_end():
    floor = CAPTURES.scenes * CAPTURES.fetched / Machines(1).store_bytes_s
    assert floor < simulate(CAPTURES, Machines(1000)).seconds < 1.5 * floor
    assert simulate(CAPTURES, Machines(10)).seconds > 10 * floor


def test_the_page_has_the_figures_of_its_record(tmp_path):
    record = {
        "hagoromo": "0",
        "here": HERE,
        "full": FULL,
        "figure": FIGURE,
        "paper": on_paper(FIGURE, 1e-3) | {"by": FIGURE},
        "by_modes": on_paper(OF_MODES, 1e-3) | {"by": OF_MODES},
    }
    write_cluster_page(tmp_path, record | {"simulated": simulated(HERE)})
    page = (tmp_path / "cluster.md").read_text(encoding="utf-8")
    assert (
        "| 1 | 9.0 | 5.0 | the same | 2.0 |" in page
        and "| 2 | one, at the first task | the same | 8 |  | 2.0 |" in page
    )
    assert "these are 200 hours of CPU: 4.17 d on two cores" in page
    assert "192 × 128 pixels" in page and "it would be 400 hours of CPU." in page
    assert "| 2 | one, at the first tile | the same | 80 | 3.00 |" in page
    assert page.count("| 1000 |") == 4 and (tmp_path / "cluster.png").stat().st_size > 10_000


def test_steps_of_walks_double_those_that_are_done():
    assert list(steps(100.0)) == [16.0, 16.0, 32.0, 36.0] and list(steps(7.0)) == [7.0]


def test_on_paper_time_is_work_over_cores_and_workers():
    """200 hours of CPU; tasks take random times, and the last of a step keeps others waiting."""
    paper = on_paper(FIGURE, 1e-3)
    assert paper["walk_s"] == pytest.approx(1e-5) and paper["cpu_s"] == pytest.approx(7.2e5)
    one, _, hundred = (row["seconds"] for row in paper["rows"])
    assert 0.95 * 7.2e5 / 16 < one < 1.1 * 7.2e5 / 16 and 0.01 * one < hundred < 0.02 * one


def test_times_are_told_in_their_unit():
    assert [hours(s) for s in (90.0, 600.0, 7200.0, 864000.0)] == ["90 s", "10 min", "2 h", "10 d"]
