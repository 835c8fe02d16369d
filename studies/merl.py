"""The study of MERL: measured materials, read by a goniometer, fitted with our facets and with GGX + Lambert.

    python -m studies.merl ../shared/data/merl_fits --out out/merl

Enters: a folder with merl_sgd.json and merl_abc.json. Leaves: results.json, merl.md and merl.png, which belong to docs.
Each model is fitted by the package, and ours and GGX by SciPy as well, so that both can be judged. A material
that is done has a file of its own in `.merl.building` beside the result: the same command goes on where it was stopped.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.shared_options import HERE, Scheduler
from hagoromo.cluster.cluster import here_or_on
from hagoromo.files.cache import key_of
from hagoromo.files.resumable import resumable_folder
from hagoromo.measurement.material.lack_of_fit import LEVEL
from hagoromo.measurement.material.material_objective import expected
from hagoromo.measurement.material.model_choice import Facets, Interface, choose_fit
from hagoromo.measurement.parameters import unpack_theta
from studies.command import command
from studies.goniometer import cosines_of, goniometer, readings
from studies.merl_page import write_merl_page
from studies.merl_rival import GGX, GGX_COLOURED, RIVALS, fit_rival
from studies.merl_truth import Truth, read_truths

Array = NDArray[np.float64]
MERL_NOISE = 0.01  # relative, of each reading
MERL_SEED = 0
OURS: dict[str, tuple[Facets, Interface]] = {
    "Gaussian": ("gaussian", "neutral"),
    "Student-t": ("student-t", "neutral"),
    "Student-t, coloured": ("student-t", "coloured"),
    "by evidence": ("auto", "auto"),
}
BY_EVIDENCE = "by evidence"  # the model that the package chooses: what `measure` gives
METHODS = (*OURS, *RIVALS)


@dataclass(frozen=True)
class MerlRow:
    """One material: median relative error over directions and channels of each method, and the statements of our fit.

    rejected: whether the test reports lack of fit. p_value: of that test. model_error: relative, stated by the fit.
    nu, interface_colour: of the model chosen by evidence; nu is None for Gaussian facets.
    """

    truth: str
    material: str
    error: dict[str, float]
    rejected: bool
    p_value: float
    model_error: float
    nu: float | None
    interface_colour: tuple[float, ...]


def merl_study(
    folder: str | Path,
    out: str | Path,
    force: bool = False,
    progress: hg.Progress = hg.silent,
    scheduler: str | int | None = None,
) -> dict[str, Any]:
    """The whole study, written to the folder `out`; gives the record of results.json. scheduler: see `hg.render`.

    Materials that an interrupted run of the same program and truths has done are taken from its files.
    """
    truths = read_truths(folder)
    read = {path.name: path.read_text(encoding="utf-8") for path in sorted(Path(folder).glob("*.json"))}
    done = key_of(["merl", MERL_NOISE, MERL_SEED, *METHODS, read])
    with resumable_folder(out, done, force) as home:
        cases = [(kind, name, of) for kind, named in truths.items() for name, of in named.items()]
        tasks = [(*case, np.random.default_rng([MERL_SEED, i])) for i, case in enumerate(cases)]
        rows = _rows(tasks, home.parent / "rows", scheduler, progress)
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


def study(kind: str, name: str, truth: Truth, random: np.random.Generator) -> MerlRow:
    """One material read and fitted by every method."""
    directions = goniometer()
    flat = cosines_of(directions)
    clean = truth(flat)
    values = clean * (1.0 + MERL_NOISE * random.standard_normal(clean.shape))
    observed = readings(directions, values, (MERL_NOISE * values) ** 2)
    used = np.asarray(observed.used.all(axis=1))
    error = {
        method: _median_error(fit_rival(rival, flat, values, used), clean, used) for method, rival in RIVALS.items()
    }
    try:
        fits = {method: choose_fit(observed, None, *model).fitted.fit for method, model in OURS.items()}
    except hg.InputError as refused:
        raise hg.InputError(f"{name}: {refused}") from refused
    error |= {method: _median_error(expected(observed.sight, fit.theta), clean, used) for method, fit in fits.items()}
    best = fits[BY_EVIDENCE]
    tested = hg.lack_of_fit(best)
    rejected, p_value = (tested.rejected, tested.p_value) if tested else (False, 1.0)
    _, _, _, _, nu, colour = unpack_theta(best.theta)
    ordered = {method: error[method] for method in METHODS}
    shape = nu if np.isfinite(nu) else None, tuple(colour.tolist())
    return MerlRow(kind, name, ordered, rejected, p_value, best.residuals.model_error, *shape)


def _rows(
    tasks: list[tuple[Any, ...]], kept: Path, scheduler: str | int | None, progress: hg.Progress
) -> list[MerlRow]:
    """The row of every task, those in the files of the folder `kept` not fitted again; the others are put there."""
    kept.mkdir(exist_ok=True)
    files = [kept / f"{number}.json" for number in range(len(tasks))]
    left = [number for number, file in enumerate(files) if not file.exists()]
    with here_or_on(scheduler) as workers:
        for more, (k, row) in enumerate(workers.results(study, [tasks[number] for number in left]), 1):
            with hg.whole_file(files[left[k]]) as file:
                hg.write_json(file, asdict(row))
            progress((len(tasks) - len(left) + more) / len(tasks), row.material)
    rows: list[dict[str, Any]] = [hg.read_json(file) for file in files]
    return [MerlRow(**row | {"interface_colour": tuple(row["interface_colour"])}) for row in rows]


def summary(rows: list[MerlRow]) -> dict[str, Any]:
    """Median, quartiles and worst over the materials, of each method; the share that our result calls ill fitted.

    nearer: share of the materials whose error is below that of GGX + Lambert, and of it with a coloured interface.
    """
    errors = {method: np.array([row.error[method] for row in rows]) for method in METHODS}
    figures = {
        method: {
            "quartile_1": float(np.percentile(of, 25)),
            "median": float(np.median(of)),
            "quartile_3": float(np.percentile(of, 75)),
            "worst": float(of.max()),
            "worst_material": rows[int(of.argmax())].material,
            "nearer_than_ggx": float(np.mean(of < errors[GGX])),
            "nearer_than_ggx_coloured": float(np.mean(of < errors[GGX_COLOURED])),
        }
        for method, of in errors.items()
    }
    off = errors[BY_EVIDENCE] > 3.0 * MERL_NOISE
    rejected = np.array([row.rejected for row in rows])
    return {
        "materials": len(rows),
        "error": figures,
        "with_tails": int(sum(row.nu is not None for row in rows)),
        "coloured": int(sum(len(set(row.interface_colour)) > 1 for row in rows)),
        "rejected": int(rejected.sum()),
        "off": int(off.sum()),
        "off_and_rejected": int((off & rejected).sum()),
    }


def _median_error(model: Array, clean: Array, used: np.ndarray) -> float:
    return float(np.median(np.abs(model - clean)[used] / clean[used]))


def main(folder: Positional[Path], out: Path, scheduler: Scheduler = HERE, force: bool = False) -> None:
    """Study the published fits of MERL in FOLDER.

    Args:
        folder: with merl_sgd.json and merl_abc.json.
        out: where to write results.json, merl.md and merl.png.
        force: replace an existing result.
    """
    with hg.progress_bar("MERL") as progress:
        record = merl_study(folder, out, force, progress, scheduler.chosen)
    for kind, of in record["summary"].items():
        for method, figures in of["error"].items():
            low, middle, high, worst = (100 * figures[key] for key in ("quartile_1", "median", "quartile_3", "worst"))
            nearer = 100 * figures["nearer_than_ggx"]
            print(f"{kind}, {method}: {low:.1f} / {middle:.1f} / {high:.1f} %, worst {worst:.0f} %", end="; ")
            print(f"nearer than GGX + Lambert for {nearer:.0f} %")
        print(f"{kind}: {of['rejected']} of {of['materials']} rejected as ill fitted")
    print(f"wrote {out / 'merl.md'}")


if __name__ == "__main__":
    command(main)
