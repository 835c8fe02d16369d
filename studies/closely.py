"""The pictures of the how-to on looking closely: a simulated tile with a hairline crack and a faded ring.

    python -m studies.closely --out out/closely

Leaves: the measurement, maps, a profile, a film in raking light and the page, as the commands of the how-to write them,
and maps.jpg, profile.png, raking.jpg and page.jpg, which the how-to shows.
"""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.image.film.film import strip
from studies.chromium import chromium_page
from studies.command import command
from studies.published import CLAY, GLAZE, SIDE, feather, scene_of

CRACK_DEPTH, CRACK_WIDTH = 1.2e-4, 0.012  # m, and of half the side of the tile
RING, RING_WIDTH = (-0.42, 0.45, 0.28), 0.05  # middle and radius, and width, of half the side
FADED = ([400, 520, 600, 700], [0.24, 0.545, 0.81, 0.86])  # of the ring: by a hair other than the clay
LINE = (246.0, 150.0, 280.0, 222.0)  # px, across the crack
SHOWN_FRAMES = 6
AWAY = 0.5  # m, of the camera


def closely(out: str | Path, force: bool = False, progress: hg.Progress = hg.silent) -> hg.HeightProfile:
    """All pictures in the folder `out`; the profile."""
    with hg.whole_folder(out, force) as home:
        capture = hg.simulate(scene(), name="Cracked tile", progress=hg.part_of(progress, 0.0, 0.4))
        capture = replace(capture, points=None, normals=None)  # as of a dome: the shape is not known
        measured = hg.measure(capture, distance=AWAY, progress=hg.part_of(progress, 0.4, 0.3))
        measured.save(home / "measured")
        maps = hg.inspection_maps(home / "measured")
        maps.save(home / "maps")
        found = hg.profile(home / "measured", LINE[:2], LINE[2:])
        found.save(home / "profile.csv")
        hg.raking(home / "measured", home / "raking", frames=24, longest=340)
        hg.publish(home / "measured", home / "page.html")
        pictures(home)
        print(*maps.sentences, found.sentence, sep="\n")
    progress(1.0, "")
    return found


def scene() -> hg.Scene:
    """The tile of `studies.published`, with a crack across it and a ring of a pigment that has nearly faded."""
    heights, glazed = feather()
    axis = np.linspace(-1.0, 1.0, SIDE)
    x, y = np.meshgrid(axis, axis)
    path = 0.35 * x - 0.3 + 0.04 * np.sin(9.0 * x)
    heights = heights - CRACK_DEPTH * np.exp(-(((y - path) / CRACK_WIDTH) ** 2))
    ring = np.abs(np.hypot(x - RING[0], y - RING[1]) - RING[2]) < RING_WIDTH
    faded = replace(CLAY, body_colour=hg.Spectrum(*FADED), name="faded")
    parts = {"clay": (~glazed & ~ring, CLAY), "faded": (ring & ~glazed, faded), "glaze": (glazed, GLAZE)}
    return scene_of(heights, parts)


def pictures(home: Path) -> None:
    """What the how-to shows, of the files in `home`."""
    names = "curvature", "occlusion", "stretch"
    maps = [np.asarray(hg.read_png(home / "maps" / f"{name}.png"), np.uint8) for name in names]
    _write_jpeg(home / "maps.jpg", np.concatenate(maps, axis=1))
    frames = sorted((home / "raking").glob("frame_*.png"))
    some = [np.asarray(hg.read_png(one), np.uint8) for one in frames[:: len(frames) // SHOWN_FRAMES]]
    _write_jpeg(home / "raking.jpg", strip(some))
    page_picture(home / "page.html", home / "page.jpg")


def page_picture(page: Path, out: Path) -> None:
    """The page as Chromium shows it, with curvature and the heights along LINE."""
    with chromium_page(page.resolve().as_uri(), (1180, 900)) as shown:
        shown.evaluate("() => hagoromo.ready")
        shown.get_by_role("button", name="Curvature").click()
        shown.keyboard.press("h")
        data = json.loads(shown.evaluate("() => document.getElementById('hv-data').textContent"))
        left, top = data["closely"]["errors"]["x"], data["closely"]["errors"]["y"]
        start, end = [LINE[0] - left, LINE[1] - top], [LINE[2] - left, LINE[3] - top]
        shown.evaluate(f"() => hagoromo.profile({start}, {end})")
        shown.wait_for_timeout(1500)
        shown.screenshot(path=out, type="jpeg", quality=85)


def _write_jpeg(path: Path, picture: NDArray[np.uint8]) -> None:
    from PIL import Image

    Image.fromarray(picture).save(path, quality=88)


def main(out: Path, force: bool = False) -> None:
    """Write the pictures.

    Args:
        out: where to write the result.
        force: replace an existing result.
    """
    with hg.progress_bar("closely") as progress:
        closely(out, force, progress)


if __name__ == "__main__":
    command(main)
