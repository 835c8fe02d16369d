"""The page of the how-to on publishing: a glazed tile, simulated, measured, published, and opened in a browser.

    python -m studies.published --out out/published

Leaves: page.html, the capture and the measurement that it was made from, and published.jpg, the page in Chromium.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from studies.chromium import chromium_page
from studies.command import command

SIZE, SIDE, PIXELS = 0.06, 321, 340  # side of the tile [m], vertices along it, pixels of the photographs
RELIEF = 0.0016  # height of the feather [m]
AZIMUTHS, ELEVATIONS = (0, 60, 120, 180, 240, 300), (35, 65)  # of the lamps [°]
CLAY = hg.Reflectance(0.25, 0.0, 0.3, 1.45, hg.Spectrum([400, 520, 600, 700], [0.25, 0.55, 0.8, 0.85]), name="clay")
GLAZE = hg.Reflectance(0.25, 2.2, 0.07, 1.5, hg.Spectrum([400, 470, 560, 700], [0.75, 0.8, 0.35, 0.12]), name="glaze")


def published(out: str | Path, force: bool = False, progress: hg.Progress = hg.silent) -> hg.Published:
    """The page in the folder `out`."""
    with hg.whole_folder(out, force) as home:
        capture = hg.simulate(tile_scene(), name="Glazed tile", progress=hg.part_of(progress, 0.0, 0.6))
        capture.save(home / "capture")
        measured = hg.measure(capture, progress=hg.part_of(progress, 0.6, 0.3))
        measured.save(home / "measured")
        page = hg.publish(measured, home / "page.html")
        picture(home / "page.html", home / "published.jpg")
    progress(1.0, "")
    return page


def tile_scene() -> hg.Scene:
    """A domed tile of matte clay with a glazed feather in relief, under lamps all around, seen from above."""
    heights, glazed = feather()
    return scene_of(heights, {"clay": (~glazed, CLAY), "glaze": (glazed, GLAZE)})


def scene_of(heights: NDArray[np.float64], parts: Mapping[str, tuple[NDArray[np.bool_], hg.Reflectance]]) -> hg.Scene:
    """A tile of `heights` [m] at its vertices, of parts by name: where they are, and their reflectance."""
    axis = np.linspace(-SIZE / 2, SIZE / 2, SIDE)
    x, y = np.meshgrid(axis, axis)
    vertices = np.stack([x, y, heights], axis=-1).reshape(-1, 3)
    index = np.arange(SIDE * SIDE).reshape(SIDE, SIDE)
    a, b, c, d = index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]
    faces = np.stack([np.stack([a, b, c], axis=-1), np.stack([a, c, d], axis=-1)], axis=2).reshape(
        SIDE - 1, SIDE - 1, 2, 3
    )
    surfaces = []
    for name, (where, body) in parts.items():
        own = faces[where[:-1, :-1]].reshape(-1, 3)
        surfaces.append(hg.Surface(body, vertices=vertices, faces=own, name=name, smooth=True))
    return hg.Scene(camera(), tuple(lamps()), surfaces=tuple(surfaces))


def feather() -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Heights of the tile [m], and where it is glazed."""
    axis = np.linspace(-1.0, 1.0, SIDE)
    x, y = np.meshgrid(axis, axis)
    along, across = (x + y) / np.sqrt(2.0), (y - x) / np.sqrt(2.0)
    across = across - 0.12 * np.sin(1.6 * along)
    width = (
        0.34 * np.sqrt(np.clip(1.0 - ((along - 0.05) / 0.95) ** 2, 0.0, 1.0)) * np.clip((along + 0.9) / 0.5, 0.0, 1.0)
    )
    inside = np.clip((width - np.abs(across)) / 0.09, 0.0, 1.0)
    barbs = 0.5 + 0.5 * np.cos(38.0 * (along - 0.9 * np.abs(across)))
    shaft = np.exp(-((across / 0.03) ** 2)) * (np.abs(along) < 0.97)
    heights = inside * (0.45 + 0.2 * barbs * inside) + 0.5 * shaft
    rim = np.clip((np.maximum(np.abs(x), np.abs(y)) - 0.94) / 0.04, 0.0, 1.0)
    dome = 4.0 * (1.0 - 0.5 * (x**2 + y**2))
    return RELIEF * (heights + 0.6 * rim + dome), (inside > 0.3) | (shaft > 0.5)


def camera() -> hg.Camera:
    """Above the tile, with the response of a camera."""
    distance = 0.5
    focal = 0.9 * PIXELS * distance / SIZE
    sensor = hg.Sensor(exposure=40_000.0, full_well=40_000.0, read_noise=5.0, gain=10.0, black_level=128.0, bits=12)
    bare = hg.Camera(
        PIXELS, PIXELS, (focal, focal), (PIXELS / 2, PIXELS / 2),
        response=hg.Response.load("canon_eos_300d"), sensor=sensor,
    )  # fmt: skip
    return bare.look_at(eye=(0.0, 0.0, distance), target=(0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))


def lamps() -> list[hg.Lamp]:
    """Far lamps of daylight, by azimuth and elevation."""
    found = []
    for elevation in ELEVATIONS:
        for azimuth in AZIMUTHS:
            a, e = np.radians(azimuth + elevation / 2), np.radians(elevation)
            way = (np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e))
            name = f"{azimuth} at {elevation}"
            found.append(hg.Lamp(to_lamp=way, intensity=2.0, spectrum=hg.Spectrum.named("D65"), name=name))
    return found


def picture(page: Path, out: Path) -> None:
    """The page as Chromium shows it, after a click on the disc of the lamp."""
    with chromium_page(page.resolve().as_uri(), (1180, 760)) as shown:
        shown.evaluate("() => hagoromo.ready")
        pad = shown.locator("#hv-pad").bounding_box()
        assert pad is not None
        shown.mouse.click(pad["x"] + 0.68 * pad["width"], pad["y"] + 0.3 * pad["height"])
        shown.wait_for_timeout(1500)
        shown.screenshot(path=out, type="jpeg", quality=82)


def main(out: Path, force: bool = False) -> None:
    """Write the page.

    Args:
        out: where to write the result.
        force: replace an existing result.
    """
    with hg.progress_bar("published") as progress:
        print(published(out, force, progress))


if __name__ == "__main__":
    command(main)
