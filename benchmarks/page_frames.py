"""Frames a second of published pages in Chromium, drawn in software: a measured object, with cast shadows and without,
and a volume box under one lamp and four.

    python benchmarks/page_frames.py [--sides 512 1024] [--frames 20] [--rounds 3]

A relief of bumps of two materials, gloss and errors for every pixel, fills the picture; the window shows one of its
pixels on one of the screen. The lamp moves from frame to frame and everything is drawn again. Medians of rounds in turn
go to out/bench/page_frames.json; `benchmarks/page.py` puts them into docs/performance.md.
"""

from __future__ import annotations

import argparse
import statistics
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import sync_playwright
from turns import record

import hagoromo as hg
from hagoromo_page.publication.colours import stack_colours
from hagoromo_page.publication.document import document
from hagoromo_page.publication.lit import hemisphere
from hagoromo_page.publication.object_page import PageSource, single_page
from hagoromo_page.publication.stack_page import stack_page
from hagoromo_page.publication.surface_maps import SurfaceMaps
from hagoromo_page.publication.weight_stack import WeightStack

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
from tests.app.in_browser import CHROMIUM, FLAGS
from tests.app.published_ball import TRUTHS, estimate

BUMPS, HEIGHT, DISTANCE = 9, 0.03, 1.0  # along a side; of the side; from the camera [sides]
LAMPS = 48  # of the weights
LIMIT = 100_000_000  # bytes: pages are not reduced
PANEL = 300, 230  # px of the window that are not picture: across, down


def main() -> None:
    """Make the pages, draw them in turn, and record the medians."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--sides", type=int, nargs="+", default=[512, 1024], help="px of a side of the picture")
    parser.add_argument("--frames", type=int, default=20, help="in a round")
    parser.add_argument("--rounds", type=int, default=3)
    asked = parser.parse_args()
    rows: list[dict[str, Any]] = []
    with tempfile.TemporaryDirectory() as home, sync_playwright() as running:
        browser = running.chromium.launch(executable_path=CHROMIUM, args=FLAGS)
        for side in asked.sides:
            for what, make in (("measured object", object_page), ("volume box", box_page)):
                path = Path(home) / f"{what}{side}.html"
                path.write_text(make(side), encoding="utf-8")
                rows += [
                    {"page": what, "side": side, "bytes": path.stat().st_size} | found
                    for found in _timed(browser, path, side, asked.frames, asked.rounds)
                ]
        browser.close()
    for row in rows:
        print(row)
    record("page_frames", rows)


def _timed(browser: Any, path: Path, side: int, frames: int, rounds: int) -> list[dict[str, Any]]:
    """Frames a second of each way to draw the page at `path`."""
    page = browser.new_page(viewport={"width": side + PANEL[0], "height": side + PANEL[1]})
    page.goto(path.as_uri())
    page.evaluate("() => hagoromo.ready")
    page.keyboard.press("1")
    shadows = page.evaluate("() => hagoromo.state.shadows")
    ways = {"1 lamp": (1, False), "4 lamps": (4, False)}
    if shadows:
        ways |= {"1 lamp, shadows": (1, True), "4 lamps, shadows": (4, True)}
    rates: dict[str, list[float]] = {name: [] for name in ways}
    for _ in range(rounds):
        for name, (lamps, lit) in ways.items():
            page.evaluate(
                "([n, lit]) => { const s = hagoromo.state; s.shadows = lit; s.lamp = 0;"
                "s.lamps = Array.from({length: n}, (_, k) => ({...s.lamps[0], x: 0.4 * Math.cos(2 * k), "
                "y: 0.4 * Math.sin(2 * k), strength: 1 / n})); hagoromo.redraw(); }",
                [lamps, lit],
            )
            rates[name].append(page.evaluate(f"() => hagoromo.framesPerSecond({frames})"))
    page.close()
    return [{"drawn": name, "frames_per_second": statistics.median(found)} for name, found in rates.items()]


def object_page(side: int) -> str:
    """The page of a measured relief of side × side px."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, side), np.linspace(0.5, -0.5, side))
    turn = np.pi * BUMPS
    relief = HEIGHT * np.cos(turn * x) * np.cos(turn * y)
    slopes = [HEIGHT * turn * np.sin(turn * a) * np.cos(turn * b) for a, b in ((x, y), (y, x))]
    normals = np.stack([*slopes, np.ones_like(x)], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    labels = (relief > 0).astype(np.int64)
    even = 1.0 + 0.2 * np.sin(40 * x) * np.sin(31 * y)
    body = np.array([truth.alpha_body for truth in TRUTHS])[labels] * even[..., None]
    beta, gamma = (np.array([getattr(truth, key) for truth in TRUTHS])[labels] * even for key in ("beta", "gamma"))
    camera = hg.Camera(side, side, (side * DISTANCE, side * DISTANCE), (side / 2, side / 2))
    materials = tuple(estimate(f"material {k}", truth) for k, truth in enumerate(TRUTHS))
    maps = SurfaceMaps(
        "relief", materials, camera, labels, normals, body, DISTANCE - relief, beta, gamma, None, 0.01 * even,
        None, 0.05 * even, True,
    )  # fmt: skip
    return document(single_page(PageSource(maps, photographed(camera)), LIMIT).viewer)


def photographed(camera: hg.Camera) -> Any:
    """A camera and one far lamp."""
    from hagoromo.measurement.photographed import Photographed

    return Photographed(camera, (hg.Lamp(to_lamp=(0, 0, -1), name="front"),))


def box_page(side: int) -> str:
    """The page of weights of a relief of side × side px in two colours, lit by Lambert's law with a gloss."""
    x, y = np.meshgrid(np.linspace(-0.5, 0.5, side), np.linspace(0.5, -0.5, side))
    turn = np.pi * BUMPS
    slopes = [2.0 * HEIGHT * turn * np.sin(turn * a) * np.cos(turn * b) for a, b in ((x, y), (y, x))]
    normals = np.stack([*slopes, np.ones_like(x)], axis=2).astype(np.float32)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    directions = hemisphere(LAMPS, 0.0)
    cosine = np.maximum(normals @ directions.T.astype(np.float32), 0.0)
    weights = np.stack([0.3 * cosine, 0.1 * cosine**8], axis=3)
    colours = hg.Spectrum([400, 700], [0.3, 1.0]), hg.Spectrum.constant(1.0)
    stack = WeightStack(weights, np.ones((side, side), np.float32), directions, colours)
    return document(stack_page(stack, stack_colours(colours, None, ()), "relief", LIMIT)[0].viewer)


if __name__ == "__main__":
    main()
