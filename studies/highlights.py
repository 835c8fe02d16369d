"""The study of highlights: where photographs under unseen lamps are missed, and what each step of the fit gives.

    python -m studies.highlights --out out/highlights

Leaves: table.md, results.json, and the table on the screen. Objects are those of `mirror_objects`; every EVERY-th lamp
is kept aside. Errors are relative root mean squares over all pixels, clipped at white, in the mean of these lamps.
The last rows are no part of the program: a free table of the half angle, monotone, by non-negative least squares, on
the program's normals and on true ones; with clipped values as lower bounds or left out; and as means over 3 × 3 normals
of each pixel, which are those between it and its neighbours.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.measurement.normals.normals import (
    NormalMap,
    smooth,
    solve_with_one_lobe,
    with_further_lobes,
    with_normals_of_lobes,
)
from hagoromo.measurement.normals.photometric_model import predicted
from hagoromo.measurement.normals.shading import shading
from studies.command import command
from studies.mirror_objects import OBJECTS, MirrorObject, mirror_object
from studies.table import print_table

Array = NDArray[np.float64]
FIRST, EVERY = 3, 8  # lamps that are kept aside: the fourth, and every eighth after it
NODES = np.radians(np.r_[np.arange(0.0, 4.0, 0.25), np.arange(4.0, 8.0, 0.5), 8.0, 10.0, 12.0, 14.0, 20.0, 30.0, 90.0])
WEIGHT_ERROR = 0.05  # relative, of values in the weights of the table
PASSES = 3  # of the table and its lower bounds
BANDS = (0.0, 1.0, 3.0, 8.0, 180.0)  # ° from the mirror direction: of the half angle φ
TITLES = ("step", "error", *(f"{low:.0f}–{high:.0f}°" for low, high in pairwise(BANDS)), "normals")


@dataclass(frozen=True, eq=False)
class UnseenLamps:
    """An object, the numbers of the lamps that were measured and of those kept aside, and the first fit."""

    truth: MirrorObject
    measured: NDArray[np.intp]
    held: NDArray[np.intp]
    plain: NormalMap

    @property
    def rest(self) -> hg.Capture:
        """The photographs that were measured."""
        return replace(self.truth.capture, photographs=tuple(self.truth.capture.photographs[k] for k in self.measured))

    def true_normals(self) -> Array:
        """(P, 3)"""
        return self.truth.normals[self.plain.views.rows, self.plain.views.columns]

    def read(self, number: int) -> Array:
        """(P, C) a photograph."""
        values = self.truth.capture.photographs[number].values
        return np.asarray(values[self.plain.views.rows, self.plain.views.columns], np.float64)

    def to_lamp(self, number: int) -> Array:
        """(P, 3) towards a lamp as stated."""
        lamp = self.truth.capture.photographs[number].lamps[0]
        return np.broadcast_to(np.asarray(lamp.to_lamp, np.float64), self.true_normals().shape)

    def row(self, name: str, shown: Array, normals: Array | None) -> list[float | str | None]:
        """Name, error, share of the squared error by bands of φ, and mean error of normals [°], of values `shown` per
        irradiance (H, C, P) under the lamps kept aside.
        """
        errors, bands, light = [], np.zeros(len(BANDS) - 1), self.plain.views.light[0].T
        for number, values in zip(self.held, shown, strict=True):
            true = self.read(number)
            squared = np.sum((np.minimum(values.T * light, 1.0) - true) ** 2, axis=1)
            half = self.truth.lamps[number] + np.array([0.0, 0.0, 1.0])
            phi = np.degrees(np.arccos(np.clip(self.true_normals() @ half / np.linalg.norm(half), -1.0, 1.0)))
            bands += np.histogram(phi, BANDS, weights=squared)[0]
            errors.append(float(np.sqrt(squared.sum() / np.sum(true**2))))
        off = None if normals is None else float(np.mean(_angle(normals, self.true_normals())))
        return [name, float(np.mean(errors)), *(bands / bands.sum()).tolist(), off]


def highlights(
    name: str, size: int = 154, lamps: int = 96, progress: hg.Progress = hg.silent
) -> list[list[float | str | None]]:
    """Rows of the table of an object: see `UnseenLamps.row`."""
    progress(0.0, f"{name}: photographs")
    truth = mirror_object(name, size, lamps)
    held = np.arange(FIRST, lamps, EVERY)
    measured = np.setdiff1d(np.arange(lamps), held)
    rest = replace(truth.capture, photographs=tuple(truth.capture.photographs[k] for k in measured))
    progress(0.2, f"{name}: normals")
    plain = solve_with_one_lobe(rest)
    case = UnseenLamps(truth, measured, held, plain)
    progress(0.4, f"{name}: lobes")
    steps = {"one-lobe normals, lobes": with_further_lobes(rest, plain)}
    steps["+ smooth normals"] = with_further_lobes(rest, smooth(plain))
    steps["+ normals of all lobes"] = found = with_normals_of_lobes(rest, steps["+ smooth normals"])
    rows = [case.row(step, _forecast(case, one), one.fit.normals) for step, one in steps.items()]
    progress(0.8, f"{name}: tables")
    before, true = steps["one-lobe normals, lobes"].fit.normals, case.true_normals()
    for step, normals, bounds, footprint in (
        ("free table on one-lobe normals", before, True, False),
        ("free table", found.fit.normals, True, False),
        ("free table, clipped left out", found.fit.normals, False, False),
        ("free table, footprint", found.fit.normals, True, True),
        ("free table, true normals", true, True, False),
        ("free table, true normals, footprint", true, True, True),
    ):
        rows.append(case.row(step, free_table(case, found, normals, bounds, footprint), normals))
    views = plain.views
    noiseless = np.stack([truth.noiseless[k][views.rows, views.columns].T / views.light[0] for k in held])
    return [*rows, case.row("the truth without noise", noiseless, None)]


def free_table(case: UnseenLamps, solved: NormalMap, normals: Array, bounds: bool, footprint: bool) -> Array:
    """(H, C, P) values under the lamps kept aside, of a monotone table of the half angle on `normals` (P, 3).

    bounds: clipped values count as lower bounds; else they are left out. footprint: means over 3 × 3 normals a pixel.
    """
    from scipy.optimize import nnls

    fit, views = solved.fit, solved.views
    parts = _parts(views, normals) if footprint else [(normals, 1.0)]
    even, rest, steps = fit.evenness(views.place), [], np.tril(np.ones((len(NODES),) * 2)).T
    for k, number in enumerate(case.measured):
        clipped = (case.read(number) >= 1.0).any(axis=1)
        body = even[k] * _lit(solved, normals, views.to_lamp[k]) * fit.body.mean(axis=0)
        values = case.read(number).mean(axis=1) / views.light[k].mean(axis=0)
        spread = views.variance[k].mean(axis=0) / len(fit.body) + (WEIGHT_ERROR * values) ** 2
        rest.append((even[k][:, None] * _columns(views, parts, views.to_lamp[k]), values - body, clipped, spread))
    table = np.zeros(len(NODES))
    for turn in range(PASSES):
        matrix, side = np.zeros((len(NODES),) * 2), np.zeros(len(NODES))
        for columns, wanted, clipped, spread in rest:
            counts = ~clipped | (bounds and turn > 0 and columns @ table < wanted)
            weighed = columns @ steps * (counts / spread)[:, None]
            matrix, side = matrix + weighed.T @ (columns @ steps), side + weighed.T @ wanted
        scale = 1.0 / np.sqrt(np.diag(matrix) + 1e-12)
        root = np.linalg.cholesky(matrix * scale[:, None] * scale + 1e-7 * np.eye(len(NODES)))
        table = steps @ (scale * nnls(root.T, np.linalg.solve(root, side * scale))[0])
    shown = []
    for number in case.held:
        to_lamp = case.to_lamp(number)
        shown.append(fit.body * _lit(solved, normals, to_lamp) + _columns(views, parts, to_lamp) @ table)
    return np.stack(shown)


def _forecast(case: UnseenLamps, solved: NormalMap) -> Array:
    """(H, C, P) what the fit gives under the lamps kept aside."""
    views = solved.views
    return np.stack([predicted(solved.fit, case.to_lamp(k)[None], views.to_eye)[0] for k in case.held])


def _lit(solved: NormalMap, normals: Array, to_lamp: Array) -> Array:
    """(P,) what a body of 1 gives."""
    return shading(normals, to_lamp[None], solved.views.to_eye, solved.fit.rows).body[0]


def _columns(views: hg.Views, parts: Sequence[tuple[Array, float]], to_lamp: Array) -> Array:
    """(P, nodes) the interface of tables that are 1 at one node, linear between them, in the mean of the parts."""
    half = to_lamp + views.to_eye
    half /= np.linalg.norm(half, axis=1, keepdims=True)
    flat = np.array([[0.0, np.log(1e3), 0.0, 0.0]])  # β = 1, and facets so wide that D is 1
    total, pixel = np.zeros((len(half), len(NODES))), np.arange(len(half))
    for normals, weight in parts:
        light = weight * shading(normals, to_lamp[None], views.to_eye, np.tile(flat, (len(half), 1))).interface[0]
        phi = np.arccos(np.clip(np.sum(normals * half, axis=1), -1.0, 1.0))
        place = np.interp(phi, NODES, np.arange(len(NODES)))
        low = np.minimum(place.astype(np.intp), len(NODES) - 2)
        total[pixel, low] += light * (1.0 - (place - low))
        total[pixel, low + 1] += light * (place - low)
    return total


def _parts(views: hg.Views, normals: Array) -> list[tuple[Array, float]]:
    """Normals (P, 3) at 3 × 3 places of Gauss's rule in each pixel, linear between neighbours, and their weights."""
    image = views.image(normals)
    known = np.linalg.norm(image, axis=2) > 0.5
    slopes = []
    for axis in (0, 1):
        before, after = (np.roll(image, step, axis) for step in (1, -1))
        there = np.roll(known, 1, axis) & np.roll(known, -1, axis)
        slopes.append(np.where(there[..., None], 0.5 * (after - before), 0.0)[views.rows, views.columns])
    places, weights = np.polynomial.legendre.leggauss(3)
    parts = []
    for down, of_down in zip(places / 2.0, weights / 2.0, strict=True):
        for across, of_across in zip(places / 2.0, weights / 2.0, strict=True):
            turned = normals + down * slopes[0] + across * slopes[1]
            parts.append((turned / np.linalg.norm(turned, axis=1, keepdims=True), float(of_down * of_across)))
    return parts


def _angle(one: Array, other: Array) -> Array:
    return np.degrees(np.arccos(np.clip(np.sum(one * other, axis=1), -1.0, 1.0)))


def cells(row: Sequence[float | str | None]) -> list[str]:
    """A row of the table as text."""
    name, *figures, normals = row
    error, *bands = (float(one) for one in figures if one is not None)
    off = "" if normals is None else f"{normals:.3f}°"
    return [str(name), f"{error:.4f}", *(f"{100.0 * band:.0f} %" for band in bands), off]


def page(results: dict[str, list[list[float | str | None]]]) -> str:
    """The tables as Markdown."""
    lines = []
    for name, rows in results.items():
        lines += [f"| {name} | " + " | ".join(TITLES[1:]) + " |", "|---" * len(TITLES) + "|"]
        lines += ["| " + " | ".join(cells(row)) + " |" for row in rows] + [""]
    return "\n".join(lines)


def main(out: Path, objects: tuple[str, ...] = OBJECTS, lamps: int = 96, size: int = 154, force: bool = False) -> None:
    """Find out what each step gives under lamps kept aside.

    Args:
        out: folder to write.
        objects: which of the objects.
        lamps: of each object.
        size: of the photographs, width and height [px].
        force: replace an existing folder.
    """
    with hg.whole_folder(out, force) as home, hg.progress_bar("highlights") as progress:
        results = {name: highlights(name, size, lamps, progress) for name in objects}
        record = {"hagoromo": hg.__version__, "columns": list(TITLES), "lamps": lamps, "size": size, "objects": results}
        hg.write_json(home / "results.json", record)
        (home / "table.md").write_text(page(results), encoding="utf-8", newline="\n")
    for name, rows in results.items():
        print_table(f"{name}: unseen lamps, and where their squared error lies", TITLES, [cells(row) for row in rows])


if __name__ == "__main__":
    command(main)
