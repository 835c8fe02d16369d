"""The table of peers says what was measured and what was absent; timings are never tested."""

import importlib
import importlib.util
import json
import sys
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.matter.drape.sheet import Sheet

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
        table.Row("ball", "numba", "step", 1.5, 5, 0.01, 1.0, ratio=12.0, peak=300.0),
        table.Row("ball", "numpy", "step", 3.0, 5, 0.001, 1.0, ratio=24.0, as_accurate=False, peak=300.0),
        table.Row("ball", "vtk", absent="not installed: vtkmodules"),
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


def test_pictures_of_two_backends_are_compared(backends, tmp_path, capsys):
    """The CPU against itself: the same bits. The shell and the ball take every path but that of recipes and texels."""
    out = tmp_path / "backends.json"
    small = ["--lines", "36", "--rounds", "0", "--voxels", "64", "--out", str(out)]
    assert backends.main(["--backends", "llvm", "llvm", *small, "--scenes", "shell and ball"]) == 0
    assert "within 0.001 of llvm" in capsys.readouterr().out
    record = json.loads(out.read_text(encoding="utf-8"))
    assert [(row["scene"], row["difference"]) for row in record["compared"]] == [("shell and ball", 0.0)]


def test_a_picture_that_differs_and_a_backend_that_does_not_work_are_told(backends, monkeypatch, tmp_path, capsys):
    """One part in 500 is too much; a picture that is not finite is."""
    picture = np.ones((4, 4, 4), np.float32)
    frame = {"scene": "shell", "lines": 4, "picture": "p", "seconds": 1.0}
    first = {"backend": "llvm", "frames": [frame], "pictures": {"p": picture}}
    other = {"backend": "cuda", "frames": [frame], "pictures": {"p": picture * np.float32(1.002)}}
    assert backends.compared(first, other)[0]["difference"] > backends.BOUND
    other["pictures"] = {"p": np.where(np.arange(64).reshape(4, 4, 4) == 0, np.nan, picture)}
    assert backends.compared(first, other)[0]["difference"] == np.inf
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "absent.so"))
    arguments = ["--backends", "llvm", "--lines", "9", "--scenes", "shell", "--voxels", "32"]
    assert backends.main([*arguments, "--out", str(tmp_path / "backends.json")]) == 1
    assert "llvm: hagoromo.errors.InputError: no Dr.Jit backend works here" in capsys.readouterr().out


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
