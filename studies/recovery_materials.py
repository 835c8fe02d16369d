"""Materials that recoveries state: how often 95 % intervals of β, γ and n hold the truth, over several captures.

    python -m studies.recovery_materials --out out/recovery_materials [--only NUMBER …]

Three shapes under four glosses each, narrow to wide, with 24 or 48 views of 96² pixels, a near lamp each, 5 to 60° off
the eye; 32 nodes, 100 steps of each level. table.md has the rows as a table.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo.backend import vectors
from hagoromo.matter import shape as sd
from studies.recover_scenes import TrueObject, shots, simulated
from studies.recovery_scores import covered, shape_errors

SIDE, STEPS, PIXELS = 32, 100, 96
NAMES = ("beta", "gamma", "n")
GLOSSES = ((4.0, 0.06, 1.6), (1.5, 0.1, 1.4), (0.6, 0.18, 1.5), (0.25, 0.3, 1.5))  # β, γ, n


class RoundedBlock(TrueObject):
    """A block with rounded edges: large flat faces."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        return sd.rounded_box(p, (0.0, 0.0, 0.0), (0.032, 0.024, 0.02), 0.008)


class Knot(TrueObject):
    """Three bodies that blend: round parts of several sizes, and hollows between them."""

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        large = sd.sphere(p, (-0.01, 0.0, -0.006), 0.026)
        small = sd.sphere(p, (0.024, 0.008, 0.012), 0.015)
        limb = sd.capsule(p, (-0.02, -0.014, 0.016), (0.01, 0.026, -0.02), 0.011)
        return sd.smooth_union(sd.smooth_union(large, small, 0.008), limb, 0.008)


SHAPES: tuple[type[TrueObject], ...] = (TrueObject, RoundedBlock, Knot)


@dataclass(frozen=True)
class MaterialRow:
    """true, found: β [1/sr], γ [rad] and n. off: ln(found / true) of each, of n − 1. off_in_errors: the same in
    stated standard errors of the logarithms. held: whether 95 % intervals hold them. places: share [%] of true points
    of which those of position, normal and body colour do.
    """

    number: int
    shape: str
    views: int
    true: tuple[float, float, float]
    found: tuple[float, float, float]
    off: tuple[float, float, float]
    off_in_errors: tuple[float, float, float]
    held: tuple[bool, bool, bool]
    places: tuple[float, float, float] | None
    seconds: float


def measured(number: int) -> MaterialRow:
    """Recover a capture, by its number."""
    shape, views = SHAPES[number % len(SHAPES)], (24, 48)[number % 2]
    true = GLOSSES[number // len(SHAPES)]
    truth = shape(*true)
    capture = simulated(truth, shots(views, 5, 60, 10 + number, PIXELS), number).capture
    begin = time.process_time()
    found = hg.recover(capture, hg.RecoverySettings(side=SIDE, steps=STEPS, keep=0, seed=number))
    seconds = time.process_time() - begin
    material = found.record()["material"]
    aside = simulated(truth, shots(4, 5, 60, 2, PIXELS), noise=False)
    shown = shape_errors(found, aside)
    colours = np.stack([np.array(each) for each in truth.colours(vectors(shown.points))], 1)
    own = np.array([material[name] for name in NAMES])
    less = np.array([0.0, 0.0, 1.0])  # intervals of n are those of ln(n − 1)
    errors = np.array([material["standard_error"][name] for name in NAMES]) / (own - less)
    off = np.log((own - less) / (np.array(true) - less))
    ends = np.array([material["interval_95"][name] for name in NAMES]).T
    held = (ends[0] <= true) & (true <= ends[1])
    return MaterialRow(
        number, shape.__name__, views, true, _three(own), _three(off), _three(off / errors), _three(held),
        covered(found, shown, colours), seconds,
    )  # fmt: skip


def _three(values: Any) -> Any:
    return tuple(values.tolist())


def table(rows: Sequence[MaterialRow]) -> str:
    """The rows as Markdown, and what holds of all."""
    lines = [
        "| shape, views | β, γ, n | off | in stated standard errors | held | places held: position, normal, colour |",
        "|---|---|---|---|---|---|",
    ]
    for row in rows:
        true, off, errors = (
            ", ".join(form(v) for v in values)
            for form, values in (("{:g}".format, row.true), (_percent, row.off), ("{:+.1f}".format, row.off_in_errors))
        )
        held = ", ".join("yes" if each else "no" for each in row.held)
        places = "" if row.places is None else ", ".join(f"{each:.0f}" for each in row.places) + " %"
        lines.append(f"| {row.shape}, {row.views} | {true} | {off} | {errors} | {held} | {places} |")
    held = np.array([row.held for row in rows]).sum(axis=0)
    errors = np.sqrt(np.mean(np.array([row.off_in_errors for row in rows]) ** 2, axis=0))
    lines.append(
        f"\n95 % intervals of β, γ and n hold {held[0]}, {held[1]} and {held[2]} of {len(rows)}; errors are "
        f"{errors[0]:.2f}, {errors[1]:.2f} and {errors[2]:.2f} of the stated ones (root mean square).\n"
    )
    return "\n".join(lines)


def _percent(logarithm: float) -> str:
    return f"{100.0 * np.expm1(logarithm):+.1f} %"


def main() -> None:
    """Run the study."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--only", nargs="*", type=int, default=list(range(len(SHAPES) * len(GLOSSES))))
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    rows = []
    for number in given.only:
        rows.append(measured(number))
        print(json.dumps(asdict(rows[-1])), flush=True)
    hg.write_json(given.out / "rows.json", {"rows": [asdict(row) for row in rows], "version": hg.__version__})
    (given.out / "table.md").write_text(table(rows), encoding="utf-8")


if __name__ == "__main__":
    main()
