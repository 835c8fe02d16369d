"""The pictures of the how-to on the viewer: a scene, an image, photographs and a measurement in Chromium.

    python -m studies.viewer --out out/viewer

Leaves: scene.jpg, image.jpg, photograph.jpg and measurement.jpg, and what they show.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import hagoromo as hg
from hagoromo_page.viewer.browser import Browser
from hagoromo_page.viewer.open_desk import open_desk
from studies.chromium import chromium_page
from studies.command import command
from studies.published import tile_scene

WINDOW = 1240, 720  # px
QUALITY = 82
CLOTH_MM, VOXEL_MM = 12.0, 0.04
RECIPE = Path("examples/recipes/jacquard.toml")
SCENE = """
[camera]
size = [900, 720]
focal = [2300.0, 2300.0]
eye = [0.012, -0.05, 0.01]

[[lamp]]
name = "key"
position = [-0.003, -0.005, 0.0035]
intensity = 5e-5
spectrum = "D65"

[[lamp]]
name = "bulb"
to_lamp = [1.0, -0.7, 0.3]
intensity = 0.5
spectrum = "A"

[[box]]
recipe = "cloth.toml"
position = [-0.0005, 0.0, -0.0065]
"""


def viewer(out: str | Path, force: bool = False, progress: hg.Progress = hg.silent) -> None:
    """The pictures in the folder `out`."""
    with hg.whole_folder(out, force) as home:
        recipe = re.sub(r"(width|height)_mm = [\d.]+", rf"\1_mm = {CLOTH_MM}", RECIPE.read_text(encoding="utf-8"))
        recipe = re.sub(r"voxel_mm = [\d.]+", f"voxel_mm = {VOXEL_MM}", recipe)
        (home / "cloth.toml").write_text(recipe, encoding="utf-8")
        (home / "scene.toml").write_text(SCENE, encoding="utf-8")
        _look(home / "scene.toml", home / "scene.jpg", ["Lamp 1 key", "Probe"], [(0.52, 0.45), (0.35, 0.62)])
        progress(0.3, "tile")
        tile = tile_scene()
        capture = hg.simulate(tile, name="Glazed tile")
        capture.save(home / "capture")
        hg.measure(capture).save(home / "measured")
        hg.render(tile, hg.Settings(samples=24), mode="path").save(home / "image.exr")
        progress(0.8, "pictures")
        clicks = [(0.3, 0.3), (0.5, 0.5)]
        noise = "uncertainty, 0…20 %"
        _look(home / "image.exr", home / "image.jpg", ["Lamp 1 (12 lamps)", "Probe"], clicks, layer=noise)
        _look(home / "capture", home / "photograph.jpg", ["Probe"], clicks)
        _look(home / "measured", home / "measurement.jpg", ["Lamp", "Probe"], clicks[1:])
    progress(1.0, "")


def _look(
    what: Path, picture: Path, folders: list[str], clicks: list[tuple[float, float]], layer: str | None = None
) -> None:
    """A picture of the viewer with `folders` of its panel open, after clicks at shares of the window without it."""
    with _opened(what) as (browser, page):
        for name in folders:
            page.get_by_text(name, exact=True).first.click()
        own = next(iter(browser.watchers.values()))[0].client.camera
        for x, y in clicks:
            page.mouse.click(x * own.image_width, y * own.image_height, delay=60)
            _rest(browser, page)
        if layer is not None:
            browser.panel.edit("layer", layer)
            browser.panel.refresh()
            _rest(browser, page)
        page.mouse.move(5, 5)
        page.screenshot(path=picture, type="jpeg", quality=QUALITY)


@contextmanager
def _opened(what: Path) -> Iterator[tuple[Browser, Any]]:
    """A viewer and its page in Chromium."""
    browser = Browser(open_desk(what), "127.0.0.1", 0)
    with chromium_page(browser.address, WINDOW) as page:
        _rest(browser, page)
        page.locator(".mantine-Notification-closeButton").first.click()  # that Chromium draws in software
        yield browser, page
    browser.stop()


def _rest(browser: Browser, page: Any) -> None:
    """Serve until a viewer is there and no better picture comes."""
    quiet = 0
    while quiet < 15:
        quiet = 0 if browser.step() or not browser.watchers else quiet + 1
        page.wait_for_timeout(40)


def main(out: Path, force: bool = False) -> None:
    """Write the pictures.

    Args:
        out: where to write the result.
        force: replace an existing result.
    """
    with hg.progress_bar("viewer") as progress:
        viewer(out, force, progress)


if __name__ == "__main__":
    command(main)
