"""Cross-sections of two dates along a line: nothing where nothing changed, a flake where it came off, and refusals."""

import csv
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.camera.pose import pose_of, turned_about_axes
from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.surface.depth import surface_from_normals
from tests.inverse.simulated_relief import SimulatedRelief, places, relief_camera, relief_measurement

SIZE, TURN = 64, 0.003  # px, rad
FLAKED = (-0.006, 0.003, 0.0035)
LINE = (8.0, 25.0, 55.0, 31.0)  # over the flake, on BEFORE's picture; both ends beside it
ELSEWHERE = pose_of(turned_about_axes((12.0, -30.0, 75.0)), (0.3, -0.1, 0.05))
BEFORE = relief_camera(SIZE)
AFTER = relief_camera(SIZE + 5, eye=(0.03, -0.02, 0.42), roll=12.0, target=(0.001, 0.0005, 0.0))


class Worn(SimulatedRelief):
    """With edges over 2 mm: normals of pixels 0.6 mm wide show no steeper step."""

    def _inside(self, disc, x, y):
        return 0.5 * (1.0 - np.tanh((np.hypot(x - disc[0], y - disc[1]) - disc[2]) / 1e-3))


def integrated(relief, camera, seed, moved=None):
    """A measurement whose points are its noisy normals, integrated. moved: see `relief_measurement`."""
    plain = relief_measurement(relief, camera, seed, moved)
    assert plain.photographed is not None
    seen_by = plain.photographed.camera
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    points, normals, inside = places(relief, camera, rows, columns)
    noisy = normals + TURN * np.random.default_rng(seed).standard_normal(normals.shape)
    noisy /= np.linalg.norm(noisy, axis=2, keepdims=True)
    if moved is not None:
        noisy = noisy @ moved[:3, :3].T
    noisy = np.where(inside[..., None], noisy, 0.0)
    own = np.where(inside, 2.0 * TURN**2, np.inf)
    depth = float(np.median(((points - camera.position) @ camera.camera_to_world[:3, 2])[inside]))
    solved = surface_from_normals(noisy, seen_by, depth, np.where(inside, own, 1.0))
    settings = {"distance_m": depth}
    return replace(
        plain, normals=noisy.astype(np.float32), points=solved.points, normal_variance=own,
        distance_variance=solved.variance, settings=settings,
    )  # fmt: skip


def section(relief, seed=1):
    """Of a relief in another world and under another camera, against the one that nothing happened to."""
    later = integrated(relief, AFTER, seed + 50, ELSEWHERE)
    found = hg.change(integrated(SimulatedRelief(), BEFORE, seed), later, line=LINE).section
    assert found is not None
    return found


def test_a_flake_is_found_along_the_line():
    """0.1 mm deep; the true difference lies in the band at nine of ten places or more (95 % of all lines)."""
    relief = Worn(flake={FLAKED: 1e-4})
    found = section(relief)
    points = found.before.image
    camera = BEFORE
    x, y = ((points[:, k] - SIZE / 2) * 0.4 / camera.focal[0] for k in (0, 1))
    truth = 1e3 * (relief.height(x, -y) - SimulatedRelief().height(x, -y))  # mm; 0 at both ends
    deep = truth < -0.05
    assert found.unit == "mm" and found.significant[deep].all() and deep.sum() > 5
    between = found.error > 0.0
    off = np.abs(found.difference - truth)[between] / found.error[between]
    assert np.mean(off < NORMAL_95) > 0.9 and "differ significantly" in repr(found)


@pytest.mark.nightly
def test_the_same_object_shows_nothing_beyond_one_place_in_twenty():
    """Over 20 pairs; a line errs alike along itself, so that their mean share is known to 3 %."""
    shares = [section(SimulatedRelief(), seed).significant.mean() for seed in range(1, 21)]
    assert np.mean(shares) < 0.05 + 0.03


@pytest.mark.nightly
def test_command_and_page_have_the_section(tmp_path, capsys):
    folders = [tmp_path / name for name in ("first", "second")]
    integrated(SimulatedRelief(), BEFORE, 1).save(folders[0])
    integrated(Worn(flake={FLAKED: 1e-4}), AFTER, 2, ELSEWHERE).save(folders[1])
    line = ["--line", *(f"{one:g}" for one in LINE)]
    assert main(["change", *map(str, folders), *line, "--out", str(tmp_path / "out")]) == 0
    assert "along the line" in capsys.readouterr().out
    with open(tmp_path / "out" / "section.csv", encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    assert {"distance_mm", "before_mm", "after_mm", "difference_low_95_mm", "significant"} <= set(rows[0])
    assert any(row["significant"] == "1" for row in rows)
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert "Cross-section" in page and (tmp_path / "out" / "section.png").stat().st_size > 5000


def test_a_line_beside_the_picture_is_refused_before_the_work():
    before = relief_measurement(SimulatedRelief(), BEFORE, 1)
    with pytest.raises(hg.InputError, match="leaves the picture"):
        hg.change(before, before, line=(8.0, 25.0, 400.0, 31.0))
