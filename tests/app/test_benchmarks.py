"""The table of peers says what was measured and what was absent; timings are never tested."""

import importlib
import importlib.util
import json
import sys
import time
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.files import apart
from hagoromo.files.picture import read_picture
from hagoromo.files.png import write_png
from hagoromo_matter.drape.sheet import Sheet

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def table(monkeypatch):
    """The module, loaded as the benchmark does: its folder first on the path."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    spec = importlib.util.spec_from_file_location("peers_table", BENCHMARKS / "peers_table.py")
    assert spec and spec.loader
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, "peers_table", module)  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def test_the_table_of_peers_has_a_row_for_the_measured_and_the_absent(table, tmp_path):
    rows = [
        table.PeerRow("ball", "numba", "step", 1.5, 5, 0.01, 1.0, ratio=12.0, peak=300.0),
        table.PeerRow("ball", "numpy", "step", 3.0, 5, 0.001, 1.0, ratio=24.0, as_accurate=False, peak=300.0),
        table.PeerRow("ball", "vtk", absent="not installed: vtkmodules"),
    ]
    page, data = table.write(tmp_path, rows)
    lines = [line for line in page.read_text(encoding="utf-8").split("\n") if line.startswith("| ball")]
    assert "| 12.0 |" in lines[0]
    assert "| (24.0) |" in lines[1], "none of ours was as accurate: the ratio stands in brackets"
    assert "not installed: vtkmodules" in lines[2]
    assert len({line.count("|") for line in lines}) == 1, "every row has all columns"
    record = json.loads(data.read_text(encoding="utf-8"))
    assert record["rows"][0]["seconds"] == 1.5
    assert {"date", "processor", "cores", "versions"} <= set(record["machine"])


def test_the_steps_of_a_march_are_those_of_its_cells(monkeypatch):
    """Rays along the 5 voxels of a thin box pass 4 cells, and half a voxel before and behind them. The march lights
    each of these once, and one turn more closes the last.
    """
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    steps = importlib.import_module("steps")
    axis = np.broadcast_to(np.array([0, 0, 1], np.float32), (5, 9, 9, 3))
    matter = hg.Reflectance(0.25, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0))
    box = hg.VolumeBox.from_arrays(np.ones((5, 9, 9), np.float32), axis, 1e-3, 1.0, [matter])
    camera = hg.Camera(8, 8, (1e5, 1e5), (4.0, 4.0)).look_at((0.0041, 0.0043, 1.0), (0.0041, 0.0043, 0.0), (0, 1, 0))
    found = steps.steps_of([box], camera, [hg.Lamp(to_lamp=(0.0, 0.0, 1.0))])
    x, y = (arrays().Float(place.ravel()) for place in np.mgrid[0.5:8.5, 0.5:8.5].astype(np.float32))
    walked = np.array(steps.counts_of_walk([box], *camera.rays(x, y), 1.0))
    sys.modules.pop("steps")
    assert (walked == 6).all()
    assert found == {"steps": 7 * 64, "samples": 6 * 64}


@pytest.fixture
def backends(monkeypatch):
    """benchmarks/backends.py, loaded as a command would be."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    yield importlib.import_module("backends")
    sys.modules.pop("backends")


@pytest.mark.nightly
def test_pictures_of_two_backends_are_compared(backends, tmp_path, capsys):
    """The CPU against itself: the same bits where there is no noise. What is kept of the first is a reference."""
    out, kept = tmp_path / "backends.json", tmp_path / "kept"
    small = ["--lines", "18", "--rounds", "0", "--voxels", "64", "--out", str(out), "--scenes", "shell and ball"]
    assert backends.main(["--backends", "llvm", *small, "--keep", str(kept)]) == 0
    assert backends.main(["--backends", "llvm", *small, "--reference", str(kept / "0 llvm")]) == 0
    assert "1 of 1 pictures agree" in capsys.readouterr().out
    record = json.loads(out.read_text(encoding="utf-8"))
    assert [(row["scene"], row["difference"]) for row in record["compared"]] == [("shell and ball", 0.0)]
    (kept / "0 llvm" / "shell_and_ball.json").unlink()
    assert backends.main(["--backends", "llvm", *small, "--reference", str(kept / "0 llvm")]) == 1
    assert "0 of 1 pictures agree" in capsys.readouterr().out


def test_a_picture_that_differs_and_a_backend_that_does_not_work_are_told(backends, monkeypatch, tmp_path, capsys):
    """One part in 500 is too much; a picture that is not finite is."""
    picture = {"colour": np.ones((4, 4, 3), np.float32), "alpha": np.ones((4, 4), np.float32)}

    def found(colour):
        return backends.difference(picture, {**picture, "colour": colour}, 1e-3)

    assert found(picture["colour"] * np.float32(1.0005))["agrees"]
    assert not found(picture["colour"] * np.float32(1.002))["agrees"]
    holed = np.where(np.arange(48).reshape(4, 4, 3) == 0, np.nan, picture["colour"])
    assert found(holed)["difference"] == np.inf and not found(holed)["agrees"]
    backends.write(tmp_path / "holed.json", [], [found(holed)])
    assert json.loads((tmp_path / "holed.json").read_text(encoding="utf-8"))["compared"][0]["difference"] is None
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "absent.so"))
    arguments = ["--backends", "llvm", "--lines", "9", "--scenes", "shell", "--voxels", "32"]
    assert backends.main([*arguments, "--out", str(tmp_path / "backends.json")]) == 1
    said = capsys.readouterr().out
    assert "llvm: no Dr.Jit backend works here" in said and "nothing to compare with" in said


def test_pictures_with_noise_agree_within_it(backends):
    """Two draws of one picture do; one that is 0.5 % brighter, an eighth of the noise of a pixel, does not."""
    random, size = np.random.default_rng(1), (64, 96)
    alpha, variance = np.ones(size), np.full(size, 0.04**2)
    one, other = (
        {"y": 1.0 + 0.04 * random.standard_normal(size), "alpha": alpha, "variance": variance} for _ in range(2)
    )
    assert backends.noisy_difference(one, other)["agrees"]
    assert not backends.noisy_difference(one, {**other, "y": 1.005 * other["y"]})["agrees"]


def test_what_ends_a_process_of_a_scene_is_told(backends):
    """A time that is over, and a status without a word."""
    wait = [sys.executable, "-c", "import time; time.sleep(60)"]
    assert backends.ended(wait, {}, 0.2) == "not done after 0.2 s"
    assert (
        backends.ended([sys.executable, "-c", "raise SystemExit(3)"], {}, 60.0) == "ended with status 3, without a word"
    )
    assert backends.ended([sys.executable, "-c", ""], {}, 60.0) == ""


def test_cloth_that_passes_through_itself_is_counted(monkeypatch):
    """A level sheet with a corner that is pulled down through its middle; folded without touching it has none."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    drape = importlib.import_module("drape")
    sys.modules.pop("drape")
    u, v = np.meshgrid(np.arange(10.0), np.arange(10.0))
    points = np.stack([u, v, 0.0 * u], axis=-1)
    points[8:, 8:] = (2.3, 2.4, 1.0) + 0.1 * np.array([[[0, 0, 0], [1, 0, 0]], [[0, 1, 0], [1, 1, 0]]])
    assert drape.crossings(Sheet(points, u, v)) == 0
    points[9, 9, 2] = -1.0
    assert drape.crossings(Sheet(points, u, v)) == 3  # the edges from that corner
    assert np.abs(drape.strains(Sheet(2.0 * np.stack([u, v, 0.0 * u], axis=-1), u, v)) - 1.0).max() == 0.0


def computes(path, seconds):
    """Takes so much of computing."""
    end = time.process_time() + seconds
    while time.process_time() < end:
        pass
    return {"a": np.zeros(1)}


@pytest.fixture
def costs(monkeypatch):
    """benchmarks/apart.py, with processes of its own."""
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    monkeypatch.setattr(apart, "_idle", [])
    yield importlib.import_module("apart")
    apart._end_all()
    for name in ("apart", "apart_samples"):
        sys.modules.pop(name)


def test_what_another_process_computes_is_counted_also_when_it_has_ended(costs, tmp_path):
    before = costs.computed()
    apart.read_apart(computes, tmp_path, "a folder", 0.3)
    assert costs.computed() - before >= 0.3
    apart._end_all()
    assert costs.computed() - before >= 0.28  # of a process that has ended in steps of 10 ms, for user and system


def test_what_is_read_apart_is_read_here_to_compare(costs, monkeypatch, tmp_path, capsys):
    """No other process is asked then; the page has a row for each sample."""
    picture = np.random.default_rng(0).integers(0, 255, (13, 17, 3)).astype(np.uint8)
    write_png(tmp_path / "a.png", picture)
    case = costs.read_by("PNG", "OpenCV", tmp_path / "a.png", read_picture)
    assert (case.here(case.path) == picture).all() and not apart._idle
    assert (case.apart(case.path) == picture).all() and len(apart._idle) == 1
    kept = costs.read_here("nothing", "none", tmp_path / "a.png", costs.apart_samples.nothing, "here: it is nothing")
    monkeypatch.setattr(costs, "cases", lambda home: [case, kept])
    monkeypatch.setattr(sys, "argv", ["apart.py", "--seconds", "0", "--out", str(tmp_path / "apart.md")])
    costs.main()
    rows = [line for line in (tmp_path / "apart.md").read_text(encoding="utf-8").splitlines() if line.startswith("| ")]
    assert [row.split(" | ")[0] for row in rows] == ["| file", "| PNG", "| nothing"]
    assert rows[1].endswith("| apart |") and rows[2].endswith("| here: it is nothing |")
    assert len({row.count("|") for row in rows}) == 1 and "written" in capsys.readouterr().out
