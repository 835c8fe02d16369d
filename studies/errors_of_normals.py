"""The study of the errors of normals: how often the stated errors hold the truth, on simulated and on real balls.

    python -m studies.errors_of_normals --out out/errors_of_normals --real ../shared/data/uw_psm

The balls of `faulty_balls` have lamps, a reflectance and pixels that are not quite as stated. The real one is the
grey ball of uw_psm, whose normals follow from the circle of its mask, under the lamps of the chrome ball; the method
was chosen by simulations with it beside them. Each set counts how often 95 % regions hold the true normal (the angle,
and its two components), depth and body colour, and how large errors are beside the stated ones.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

import hagoromo as hg
from hagoromo.measurement.normals.gloss_estimate import measurement_of
from hagoromo.measurement.surface.depth import DepthSurface, surface_of
from studies.command import command
from studies.faulty_balls import BETA, CONDITIONS, GAMMA, PIXEL, FaultyBall, faulty_ball
from studies.table import print_table
from studies.uw_psm import read_lamps, read_object, sphere_normals

Array = NDArray[Any]
LAMPS, SEEDS = (12, 8), 6
OF_REAL = {"12": tuple(range(12)), "8": (0, 1, 2, 4, 5, 6, 10, 11), "8, others": (0, 2, 3, 4, 7, 8, 9, 11)}
RIM = 0.95  # of the radius
COLUMNS = {
    "own": "own [°]", "stated": "stated [°]", "found": "found [°]", "total": "angle", "component": "component",
    "ratio": "found / stated", "own_total": "angle, own errors alone", "depth": "depth", "body": "body",
}  # fmt: skip


def errors_study(real: Path | None = None, seeds: int = SEEDS) -> dict[str, Any]:
    """The record: `rows` by set and place, and `gloss`: how often intervals of β and γ hold the truth."""
    rows: dict[str, Any] = {}
    gloss: dict[str, Any] = {}
    for name, condition in CONDITIONS.items():
        for lamps in LAMPS:
            balls = [faulty_ball(condition, lamps, seed) for seed in range(seeds)]
            solved = [_solved(ball.capture, ball) for ball in balls]
            rows |= _rows(f"{name}, {lamps} lamps", [one for one, _ in solved])
            if not condition.roughness:
                held = np.array([holds for _, holds in solved])
                gloss[f"{name}, {lamps} lamps"] = {"beta": int(held[:, 0].sum()), "gamma": int(held[:, 1].sum())}
    if real is not None:
        for name, chosen in OF_REAL.items():
            rows |= _rows(f"real, {name} lamps", [_of_real(real, chosen)])
    return {"hagoromo": hg.__version__, "seeds": seeds, "rows": rows, "gloss": gloss}


def _of_real(folder: Path, chosen: tuple[int, ...]) -> dict[str, Array]:
    capture = read_object(folder, "gray", read_lamps(folder)[1])
    capture = replace(capture, photographs=tuple(capture.photographs[k] for k in chosen))
    normals = sphere_normals(folder)
    radii = np.where(np.linalg.norm(normals, axis=2) > 0.5, np.hypot(normals[..., 0], normals[..., 1]), np.inf)
    radius = float(hg.find_ball(hg.read_png(folder / "gray" / "gray.mask.png")).radius)
    return _solved(capture, FaultyBall(capture, normals, radii, np.zeros(0), PIXEL * radius * normals[..., 2]))[0]


def _solved(capture: hg.Capture, truth: FaultyBall) -> tuple[dict[str, Array], tuple[bool, bool]]:
    """Errors of each pixel beside the stated ones, and whether the intervals of β and γ hold."""
    solved = hg.solve_normals(capture)
    camera = capture.photographs[0].camera
    surface = surface_of(solved, camera, float(np.linalg.norm(camera.position)))
    material = measurement_of(capture, solved).materials[0]
    holds = [low <= true <= high for true, (low, high) in _pairs(material)]
    return _pixels(solved, surface, truth), (holds[0], holds[1])


def _pairs(material: hg.MaterialEstimate) -> list[tuple[float, tuple[float, float]]]:
    return [(BETA, material.interval_95["beta"]), (GAMMA, material.interval_95["gamma"])]


def _pixels(solved: hg.NormalMap, surface: DepthSurface, truth: FaultyBall) -> dict[str, Array]:
    """Of each pixel on the ball: its place, stated variances, and errors."""
    views, fit = solved.views, solved.fit
    at = views.rows, views.columns
    on_ball = truth.radii[at] < 1.0
    true = truth.normals[at]
    cosine = np.clip(np.einsum("pi,pi->p", true, fit.normals), -1.0, 1.0)
    off = true - cosine[:, None] * fit.normals
    off *= (np.arccos(cosine) / np.maximum(np.linalg.norm(off, axis=1), 1e-12))[:, None]
    across = np.cross(np.eye(3)[np.argmin(np.abs(fit.normals), axis=1)], fit.normals)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    turns = np.stack([np.einsum("pi,pi->p", off, axis) for axis in (across, np.cross(fit.normals, across))], axis=1)
    assert fit.errors is not None
    distance = np.linalg.norm(surface.points[at] - views.eye, axis=1)
    deeper = distance + truth.depth[at]
    found = {
        "radius": truth.radii[at], "turns": turns, "variance": fit.variance, "own": fit.errors.own,
        "depth": (deeper - deeper.mean()) ** 2 / surface.variance[at],
    }  # fmt: skip
    if truth.body.size:
        ratio = np.log(fit.body.T / truth.body[at])
        found["body"] = ratio**2 / fit.errors.body_variance.T
    return {name: one[on_ball] for name, one in found.items()}


def _rows(name: str, sets: list[dict[str, Array]]) -> dict[str, Any]:
    joined = {key: np.concatenate([one[key] for one in sets]) for key in sets[0]}
    inside = joined["radius"] < RIM
    return {
        f"{name}, {where}": _row({key: one[chosen] for key, one in joined.items()})
        for where, chosen in (("inside", inside), ("rim", ~inside))
    }


def _row(pixels: Mapping[str, Array]) -> dict[str, float]:
    """Shares that hold, and root mean squares of errors."""
    square, variance, own = (pixels["turns"] ** 2).sum(axis=1), pixels["variance"], pixels["own"]
    region, line = 0.5 * float(chi2.ppf(0.95, 2)), float(chi2.ppf(0.95, 1))  # of the variance of two turns, and of one
    row = {
        "pixels": len(square),
        "own": _degrees(own),
        "stated": _degrees(variance),
        "found": _degrees(square),
        "total": np.mean(square < region * variance),
        "component": np.mean(pixels["turns"] ** 2 < line * 0.5 * variance[:, None]),
        "ratio": np.sqrt(np.mean(square / variance)),
        "own_total": np.mean(square < region * own),
        "depth": np.mean(pixels["depth"] < line),
    }
    if "body" in pixels:
        row["body"] = np.mean(pixels["body"] < line)
    return {name: float(one) for name, one in row.items()}


def _degrees(square: Array) -> float:
    return float(np.degrees(np.sqrt(np.mean(square))))


def main(out: Path, real: Path | None = None, seeds: int = SEEDS, force: bool = False) -> None:
    """Study the errors of normals.

    Args:
        out: folder of results.json and errors_of_normals.md.
        real: folder of the photographs of real balls, uw_psm; without it, or where it is absent, none are read.
        seeds: number of simulated balls of each set.
        force: overwrite the folder.
    """
    with hg.whole_folder(out, force) as home:
        record = errors_study(real if real is not None and real.is_dir() else None, seeds)
        hg.write_json(home / "results.json", record)
        table = _table(record)
        page = hg.page_text(
            "errors_of_normals.md.j2", "studies", seeds=seeds, head=list(COLUMNS.values()), rows=table,
            gloss=record["gloss"],
        )  # fmt: skip
        (home / "errors_of_normals.md").write_text(page, encoding="utf-8", newline="\n")
    print_table("errors of normals", ("set", *COLUMNS.values()), table)
    print(f"wrote {out}")


def _table(record: Mapping[str, Any]) -> list[list[str]]:
    return [[name, *(_cell(key, row.get(key)) for key in COLUMNS)] for name, row in record["rows"].items()]


def _cell(key: str, value: float | None) -> str:
    if value is None:
        return ""
    return f"{value:.2f}" if key in ("own", "stated", "found", "ratio") else f"{100.0 * value:.0f} %"


if __name__ == "__main__":
    command(main)
