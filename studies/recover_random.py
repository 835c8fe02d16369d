"""Captures drawn at random for `recover`: objects, rigs and sensors that nobody chose, and what is found of them.

    python -m studies.recover_random --out out/recover_random [--first 0] [--seeds 24]

A capture is one number, see studies.drawn_objects: photographs of 96² pixels. 40 nodes, 60 steps of each level. Four
new views under new lamps are predicted, against exact light, unscaled, over all pixels. table.md has the rows as a
table, NUMBER.png those pictures: true, found, and their difference three times as strong.
"""

from __future__ import annotations

import time
import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

import hagoromo as hg
from hagoromo.backend import vectors
from hagoromo.files.png import write_png
from studies.command import command
from studies.drawn_objects import DrawnCapture, drawn_capture
from studies.recovery_scores import covered, held_words, psnr, said_words, shape_errors, stated

SIDE, STEPS, SEEDS = 40, 60, 24
LEAST_HELD = 85.0  # % of places that intervals of 95 % hold, below which a row is said to fall short


@dataclass(frozen=True)
class RandomRow:
    """psnr: of all new pictures [dB]; worst: of the worst one. normals: mean error [°]. surface: mean distance of true
    points from it, % of the lattice's edge. colours: median error of body colours, % of their mean. held, stated: see
    `studies.recover_strangers`. gloss: whether intervals of β, γ and n hold the truth; of a matt object that of β.
    beta: found over true; of a matt object as found. interval: of 95 % of β, γ and n. said: remarks and warnings.
    refused: the line of a refusal. fault: what went wrong that should not: an exception, or a message of several lines.
    """

    number: int
    words: str
    psnr: float | None = None
    worst: float | None = None
    normals: float | None = None
    surface: float | None = None
    colours: float | None = None
    held: tuple[float, float, float] | None = None
    stated: float = 0.0
    gloss: tuple[bool, ...] = ()
    beta: float | None = None
    interval: tuple[tuple[float, float], ...] = ()
    said: tuple[str, ...] = ()
    refused: str = ""
    fault: str = ""
    seconds: float = 0.0


def measured(number: int, out: Path) -> RandomRow:
    """Recover the capture of a number, and compare it with the truth."""
    drawn, begin = drawn_capture(number), time.process_time()
    settings = hg.RecoverySettings(side=SIDE, steps=STEPS, keep=0, seed=number)
    with warnings.catch_warnings(record=True) as warned:
        warnings.simplefilter("always")
        try:
            found = hg.recover(drawn.taken.capture, settings)
            record = found.record()
        except hg.InputError as error:
            fault = "several lines" if "\n" in str(error) else ""
            return RandomRow(number, drawn.words, refused=str(error), fault=fault)
        except Exception as error:  # the study is there to find these
            return RandomRow(number, drawn.words, fault=f"{type(error).__name__}: {error}")
    seconds = time.process_time() - begin
    said = (*(str(each.message) for each in warned), *record["remarks"])
    shown = shape_errors(found, drawn.aside)
    true = np.stack([np.array(each) for each in drawn.truth.colours(vectors(shown.points))], 1)
    at = vectors(found.lattice.from_world(shown.points))
    own = np.stack([np.array(each) for each in found.surface_field.colours_at(at)], 1)
    write_png(out / f"{number}.png", pictures(found, drawn))
    return RandomRow(
        number, drawn.words, psnr(found, drawn.aside), worst_psnr(found, drawn), float(shown.angles.mean()),
        100.0 * float(shown.distances.mean()) / (max(found.lattice.shape) * found.lattice.voxel),
        100.0 * float(np.median(np.abs(own - true)) / true.mean()), covered(found, shown, true),
        stated(found, shown.points), gloss_of(record, drawn), found.beta / (drawn.truth.beta or 1.0),
        tuple(tuple(each) for each in record["material"]["interval_95"].values()), said,
        fault="several lines" if any("\n" in each for each in said) else "", seconds=seconds,
    )  # fmt: skip


def gloss_of(record: dict, drawn: DrawnCapture) -> tuple[bool, ...]:
    """Whether 95 % intervals of β, γ and n hold the truth; of β alone where there is no gloss."""
    ends, truth = record["material"]["interval_95"], drawn.truth
    true = {"beta": truth.beta, "gamma": truth.gamma, "n": truth.n} if truth.beta else {"beta": 0.0}
    return tuple(bool(ends[name][0] <= value <= ends[name][1]) for name, value in true.items())


def worst_psnr(found: hg.Recovered, drawn: DrawnCapture) -> float:
    """PSNR of the worst of the new pictures [dB]; the peak is that of all."""
    peak, aside = max(float(exact.max()) for exact in drawn.aside.exact), drawn.aside
    pairs = zip(aside.capture.photographs, aside.exact, strict=True)
    return float(min(10.0 * np.log10(peak**2 / np.mean((found.picture(p)[0] - exact) ** 2)) for p, exact in pairs))


def pictures(found: hg.Recovered, drawn: DrawnCapture) -> np.ndarray:
    """New pictures as rows: true, found, and their difference three times as strong on grey; sRGB."""
    peak, rows = max(float(np.percentile(exact, 99.9)) for exact in drawn.aside.exact), []
    for p, exact in zip(drawn.aside.capture.photographs, drawn.aside.exact, strict=True):
        own, true = found.picture(p)[0] / peak, exact / peak
        shown = [hg.srgb_encode(np.clip(each, 0.0, 1.0)) for each in (true, own)]
        apart = np.clip(127.5 * (1.0 + 3.0 * (own - true)), 0.0, 255.0).astype(np.uint8)
        rows.append(np.concatenate([*shown, apart], axis=1))
    return np.concatenate(rows, axis=0)


def table(rows: Sequence[RandomRow]) -> str:
    """The rows as Markdown, and what holds of all."""
    lines = [
        "| capture | new views: all, worst | normals | surface, of the edge | body colours, median "
        "| 95 % intervals hold position, normal, colour | β found | β, γ, n held | what is said |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        said = said_words(row.said)
        if row.psnr is None or row.worst is None or row.normals is None or row.surface is None:
            lines.append(f"| {row.number}: {row.words} | | | | | | | | {row.fault or f'refused: {row.refused}'} |")
            continue
        held = held_words(row.held, row.stated)
        gloss = ", ".join("yes" if each else "no" for each in row.gloss)
        scores = f"{row.psnr:.1f}, {row.worst:.1f} dB | {row.normals:.1f}° | {row.surface:.2f} %"
        beta = f"{row.beta:.2f}" + ("" if "matt" in row.words else " of it")
        lines.append(
            f"| {row.number}: {row.words} | {scores} | {row.colours:.1f} % | {held} | {beta} | {gloss} | {said} |"
        )
    return "\n".join(lines) + f"\n\n{summary(rows)}\n"


def summary(rows: Sequence[RandomRow]) -> str:
    """What holds of all rows."""
    there = [row for row in rows if row.psnr is not None]
    held = np.array([row.held for row in there if row.held is not None])
    gloss = [each for row in there for each in row.gloss]
    short = [row.number for row in there if row.held is not None and min(row.held) < LEAST_HELD]
    views = np.median([row.psnr for row in there if row.psnr is not None])
    means = ", ".join(f"{each:.0f}" for each in held.mean(axis=0))
    return (
        f"Of {len(rows)} captures {sum(bool(row.refused) for row in rows)} were refused and "
        f"{sum(bool(row.fault) for row in rows)} went wrong. Median of new views: {views:.1f} dB. 95 % intervals hold "
        f"{means} % of positions, normals and colours (means of captures), and fewer than {LEAST_HELD:g} % of one of "
        f"these in {len(short)}: {', '.join(map(str, short)) or 'none'}. "
        f"Of β, γ and n {sum(gloss)} of {len(gloss)} are held."
    )


def main(out: Path, first: int = 0, seeds: int = SEEDS) -> None:
    """Recover captures of numbers in a row; rows that are in rows.json are kept.

    Args:
        out: folder to write.
        first: number of the first capture.
        seeds: how many.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "rows.json"
    rows = {row["number"]: RandomRow(**row) for row in (hg.read_json(path)["rows"] if path.exists() else [])}
    for number in range(first, first + seeds):
        if number not in rows:
            rows[number] = measured(number, out)
            print(rows[number], flush=True)
            hg.write_json(path, {"rows": [asdict(rows[key]) for key in sorted(rows)], "version": hg.__version__})
    (out / "table.md").write_text(table([rows[key] for key in sorted(rows)]), encoding="utf-8")


if __name__ == "__main__":
    command(main)
