"""The study of MERL: 80 measured materials, read by a goniometer, fitted with Torrance–Sparrow and with GGX + Lambert.

    python -m studies.merl ../shared/data/merl_fits --out out/merl

Enters: a folder with merl_sgd.json and merl_abc.json. Leaves: results.json, merl.md and merl.png, which belong to docs.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import tyro
from numpy.typing import NDArray
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.measurement.material.lack_of_fit import LEVEL
from hagoromo.measurement.material.material_objective import expected
from studies.goniometer import cosines_of, goniometer, readings
from studies.merl_page import write_merl_page
from studies.merl_rival import fit_ggx
from studies.merl_truth import Truth, read_truths

Array = NDArray[np.float64]
MERL_NOISE = 0.01  # relative, of each reading
MERL_SEED = 0
MERL_MODELS = ("Torrance–Sparrow", "GGX + Lambert", "GGX + Lambert, coloured")


@dataclass(frozen=True)
class Row:
    """One material: median relative error over directions and channels of each method, and the statements of our fit.

    rejected: whether the test reports lack of fit. p_value: of that test. model_error: relative, stated by the fit.
    """

    truth: str
    material: str
    error: dict[str, float]
    rejected: bool
    p_value: float
    model_error: float


def merl_study(
    folder: str | Path, out: str | Path, force: bool = False, progress: hg.Progress = hg.silent
) -> dict[str, Any]:
    """The whole study, written to the folder `out`; gives the record of results.json."""
    rows = []
    with hg.whole_folder(out, force) as home:
        cases = [(kind, name, of) for kind, named in read_truths(folder).items() for name, of in named.items()]
        for i, (kind, name, truth) in enumerate(cases):
            progress(i / len(cases), name)
            rows.append(study(kind, name, truth, np.random.default_rng([MERL_SEED, i])))
        record = {
            "hagoromo": hg.__version__,
            "noise": MERL_NOISE,
            "level": LEVEL,
            "directions": len(goniometer().to_lamp),
            "summary": {kind: summary([row for row in rows if row.truth == kind]) for kind in {c[0]: 0 for c in cases}},
            "rows": [asdict(row) for row in rows],
        }
        hg.write_json(home / "results.json", record)
        write_merl_page(home, record)
        progress(1.0, "")
    return record


def study(kind: str, name: str, truth: Truth, random: np.random.Generator) -> Row:
    """One material read and fitted by every method."""
    directions = goniometer()
    flat = cosines_of(directions)
    clean = truth(flat)
    values = clean * (1.0 + MERL_NOISE * random.standard_normal(clean.shape))
    observed = readings(directions, values, (MERL_NOISE * values) ** 2)
    used = np.asarray(observed.used.all(axis=1))
    colours = {
        method: fit_ggx(flat, values, used, coloured)
        for method, coloured in zip(MERL_MODELS[1:], (False, True), strict=True)
    }
    try:
        fit = hg.fit_material(observed)
    except hg.InputError as refused:
        raise hg.InputError(f"{name}: {refused}") from refused
    tested = hg.lack_of_fit(fit)
    models = {MERL_MODELS[0]: expected(observed.sight, fit.theta), **colours}
    error = {method: _median_error(model, clean, used) for method, model in models.items()}
    rejected, p_value = (tested.rejected, tested.p_value) if tested else (False, 1.0)
    return Row(kind, name, error, rejected, p_value, fit.residuals.model_error)


def summary(rows: list[Row]) -> dict[str, Any]:
    """Median, quartiles and worst over the materials, of each method; the share that our result calls ill fitted."""
    errors = {method: np.array([row.error[method] for row in rows]) for method in MERL_MODELS}
    figures = {
        method: {
            "quartile_1": float(np.percentile(of, 25)),
            "median": float(np.median(of)),
            "quartile_3": float(np.percentile(of, 75)),
            "worst": float(of.max()),
            "worst_material": rows[int(of.argmax())].material,
        }
        for method, of in errors.items()
    }
    off = errors[MERL_MODELS[0]] > 3.0 * MERL_NOISE
    rejected = np.array([row.rejected for row in rows])
    return {
        "materials": len(rows),
        "error": figures,
        "rejected": int(rejected.sum()),
        "off": int(off.sum()),
        "off_and_told": int((off & rejected).sum()),
        "ours_better": int(np.sum(errors[MERL_MODELS[0]] < errors[MERL_MODELS[1]])),
    }


def _median_error(model: Array, clean: Array, used: np.ndarray) -> float:
    return float(np.median(np.abs(model - clean)[used] / clean[used]))


def main(folder: Positional[Path], out: Path, force: bool = False) -> None:
    """Study the published fits of MERL in FOLDER.

    Args:
        folder: with merl_sgd.json and merl_abc.json.
        out: where to write results.json, merl.md and merl.png.
        force: replace an existing result.
    """
    with hg.progress_bar("MERL") as progress:
        record = merl_study(folder, out, force, progress)
    for kind, of in record["summary"].items():
        for method, figures in of["error"].items():
            low, middle, high, worst = (100 * figures[key] for key in ("quartile_1", "median", "quartile_3", "worst"))
            print(f"{kind}, {method}: {low:.1f} / {middle:.1f} / {high:.1f} %, worst {worst:.0f} %")
        print(f"{kind}: {of['rejected']} of {of['materials']} told as ill fitted")
    print(f"wrote {out / 'merl.md'}")


if __name__ == "__main__":
    tyro.cli(main)
