"""The study of calibrated responses: 28 cameras, known lights or a chart, 1 % noise; the fit against one that cheats.

    python -m studies.response_study ../shared/data --out out/response

The rival is a smooth non-negative fit whose smoothing is chosen with knowledge of the truth. Each camera is left out of
the mean of published cameras that its fit may use. The other constants of our fit were chosen over these cameras.
Leaves: results.json.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.calibration.response.calibrate_response import overlap_matrix, solve_response
from hagoromo.calibration.response.curve_prior import CurvePrior, priors_of
from hagoromo.calibration.response.curve_process import NODES, published_process
from hagoromo.calibration.response.published_curves import COMPONENTS, MEANS
from hagoromo.cluster.mapped import mapped
from studies.response_prior import latent
from studies.spectra_bench import CAMERAS, OTHERS, read_cameras, read_rawtoaces
from studies.table import print_table

READING_NOISE = 0.01  # standard deviation of a reading, relative to it
CURVE_WAVELENGTHS = np.arange(400.0, 721.0, 10.0)  # [nm], those of the measured curves
PENALTIES = np.logspace(-6, 1, 22)  # of the rival, relative to the scale of its equations
PUBLISHED = 39  # number of cameras in the mean of the prior
LEAST_PEAK_SHARE = 0.05  # of a curve's peak, above which coverage is told apart
CHART_LAMPS = (("D65",), ("A",), ("D65", "A"), ("D65", "FL11"))
Array = NDArray[np.float64]


def response_study(
    folder: str | Path,
    out: str | Path,
    every: int = 1,
    force: bool = False,
    progress: hg.Progress = hg.silent,
    scheduler: str | int | None = None,
) -> dict[str, Any]:
    """The study over every n-th camera, written to the folder `out`; gives the record of results.json.

    scheduler: see `hg.render`.
    """
    with hg.whole_folder(out, force) as home:
        cameras = dict(list(read_cameras(Path(folder) / CAMERAS).items())[::every])
        lights = known_lights()
        designs = {
            "115 lights, tabulated every 10 nm": lights @ overlap_matrix(CURVE_WAVELENGTHS),
            "115 lights, sums over the table": lights,
            **{f"chart under {' and '.join(lamps)}": chart_under(lamps) for lamps in CHART_LAMPS},
        }
        tasks = {name: (matrix, cameras) for name, matrix in designs.items()}
        others = read_rawtoaces(Path(folder) / OTHERS)
        for name in list(designs)[:2] if others else []:
            tasks[f"{name}, {len(others)} of rawtoaces"] = designs[name], others
        scores = mapped(score, list(tasks.values()), scheduler, progress, list(tasks))
        rows = dict(zip(tasks, scores, strict=True))
        record = {"hagoromo": hg.__version__, "noise": READING_NOISE, "cameras": list(cameras), "rows": rows}
        hg.write_json(home / "results.json", record)
        progress(1.0, "")
    return record


def known_lights() -> Array:
    """(115, wavelengths): colour-science's illuminants and light sources, of mean 1."""
    import colour

    sources = [*colour.SDS_ILLUMINANTS.values(), *colour.SDS_LIGHT_SOURCES.values()]
    spectra = np.array([hg.Spectrum(of.wavelengths, of.values).at(CURVE_WAVELENGTHS) for of in sources])
    return spectra / spectra.mean(axis=1, keepdims=True)


def chart_under(lamps: tuple[str, ...]) -> Array:
    """(24 · lamps, wavelengths): matrix of the readings of a ColorChecker under `lamps`, each of mean 1."""
    patches = np.array([patch.at(CURVE_WAVELENGTHS) for patch in hg.chart_spectra()])
    lights = [hg.Spectrum.named(lamp).at(CURVE_WAVELENGTHS) for lamp in lamps]
    return np.concatenate([patches * light / light.mean() for light in lights]) @ overlap_matrix(CURVE_WAVELENGTHS)


def score(matrix: Array, cameras: Mapping[str, hg.Response], seed: int = 0) -> dict[str, Any]:
    """Correlation with the true curves (median, 10th percentile), ours and the rival's, and coverage, per channel."""
    random = np.random.default_rng(seed)
    ours, rival, inside, bright = [], [], [], []
    for camera in cameras.values():
        true = np.array([camera.curve(channel).at(CURVE_WAVELENGTHS) for channel in range(3)])
        exact = true @ matrix.T
        readings = exact * (1.0 + READING_NOISE * random.standard_normal(exact.shape))
        priors = partial(priors_without, camera)
        calibration = solve_response(CURVE_WAVELENGTHS, matrix, dict(zip("RGB", readings, strict=True)), priors)
        bounds = np.moveaxis(calibration.interval_95, 1, 0)
        held = (true >= bounds[..., 0]) & (true <= bounds[..., 1])
        ours.append([_correlation(*pair) for pair in zip(calibration.response.values.T, true, strict=True)])
        rival.append([_cheating(matrix, *pair) for pair in zip(readings, true, strict=True)])
        inside.append(held.mean(axis=1))
        bright.append(held[true > LEAST_PEAK_SHARE * true.max(axis=1, keepdims=True)].mean())
    return {
        "correlation": _summary(np.array(ours)),
        "correlation_knowing_the_truth": _summary(np.array(rival)),
        "coverage": dict(zip("RGB", np.mean(inside, axis=0).tolist(), strict=True)),
        "coverage_above_5_percent": float(np.mean(bright)),
    }


def priors_without(camera: hg.Response, channel: str, wavelengths: Array) -> list[CurvePrior]:
    """The priors of a channel, `camera` left out of the mean of the published cameras."""
    figures, inside = MEANS[channel], (NODES >= CURVE_WAVELENGTHS[0]) & (NODES <= CURVE_WAVELENGTHS[-1])
    own = camera.curve("RGB".index(channel)).at(NODES)
    mean = np.array(figures.mean)
    mean[inside] -= (latent(own / own[inside].mean())[inside] - mean[inside]) / (PUBLISHED - 1)
    process = published_process(wavelengths, mean, np.array(COMPONENTS[channel]), figures)
    published, smooth = priors_of(channel, wavelengths)
    return [replace(published, mean=process[0], kernel=process[1]), smooth]


def _cheating(matrix: Array, reading: Array, true: Array) -> float:
    """The best correlation of a non-negative fit with a penalty on second differences, over all penalties."""
    from scipy.optimize import nnls

    lit = reading > 0.0
    equations = matrix[lit] / reading[lit, None]
    bend = np.diff(np.eye(len(true)), 2, axis=0) * np.abs(equations).max()
    right = np.concatenate([np.ones(lit.sum()), np.zeros(len(bend))])
    curves = [nnls(np.concatenate([equations, weight * bend]), right, maxiter=10000)[0] for weight in PENALTIES]
    return max(_correlation(curve, true) for curve in curves)


def _correlation(curve: Array, true: Array) -> float:
    return float(np.corrcoef(curve, true)[0, 1]) if curve.any() else 0.0


def _summary(values: Array) -> dict[str, dict[str, float]]:
    ends = zip(np.median(values, axis=0), np.percentile(values, 10, axis=0), strict=True)
    return {name: {"median": float(m), "p10": float(p)} for name, (m, p) in zip("RGB", ends, strict=True)}


def main(folder: Positional[Path], out: Path, scheduler: str | None = None, force: bool = False) -> None:
    """Study calibrated responses with the cameras in FOLDER.

    Args:
        folder: with camera_sensitivities/camspec_28_cameras.csv.
        out: where to write results.json.
        scheduler: run on Dask's workers: an address (tcp://host:8786), local, or a number of processes here.
        force: replace an existing result.
    """
    with hg.progress_bar("responses") as progress:
        record = response_study(folder, out, force=force, progress=progress, scheduler=scheduler)
    title = "Correlation with the true curve, median / 10th percentile, and coverage of 95 % intervals"
    fits = {"hagoromo": "correlation", "knowing the truth": "correlation_knowing_the_truth"}
    rows = [[name, fit, *_cells(row, key)] for name, row in record["rows"].items() for fit, key in fits.items()]
    print_table(title, ("readings", "fit", "R", "G", "B"), rows)
    print(f"wrote {out / 'results.json'}")


def _cells(row: dict[str, Any], key: str) -> list[str]:
    cells = [f"{of['median']:.4f} / {of['p10']:.4f}" for of in row[key].values()]
    if key == "correlation":
        shares = row["coverage"].values()
        cells = [f"{cell} · {100 * share:.0f} %" for cell, share in zip(cells, shares, strict=True)]
    return cells


if __name__ == "__main__":
    tyro.cli(main)
