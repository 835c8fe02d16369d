"""The study of few walks: what a mend of mode full leaves where few walks make it, beside the picture without it.

    python -m studies.few_walks examples/recipes --out out/full_error

A scene is solved once. Truth is path's walks through the same picture; each draw of a mend has other walks. Leaves:
few_walks.json, which the page of studies.full_error reads, and that page. A scene that is in few_walks.json is kept.
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import tyro
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.image.full.mend import Mender
from hagoromo.image.full.picture import batches_and_bands
from hagoromo.image.full.walks import FOLDS, BlockSums, PictureBlocks, WalkThrough, in_blocks, walks_here
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo_matter.demo.figures import Cast
from studies.command import command
from studies.full_error import PIXELS, RAYS, SCENES, write_page
from studies.gallery.gallery_item import changed
from studies.gallery.gallery_items import ITEMS
from studies.gallery.gallery_view import whole_scene

TRUE_WALKS = 256  # a pixel, of the truth
DRAWS = 6
WALKS = 1, 4, 16  # a pixel, of a mend
PART = 3  # with one walk through each pixel of a block in so many
APART = 1 << 12  # numbers between the first walks of two draws
RESOLUTION = 0.25  # of the boxes of the angel, 1 being that of `make figures`
OF_ANGEL = 0.25, 0.1, 0.3  # α, β and γ of all that she wears
Array = NDArray[np.float64]
Walked = NDArray[np.int64]


def whole(name: str, **more: Any) -> Callable[[Path, int], hg.Scene]:
    """A recipe of the gallery, as it is shown whole; more: keys that make it cheaper."""

    def make(recipes: Path, pixels: int) -> hg.Scene:
        item = ITEMS[name]
        record = changed(recipes, item, (item.whole or {}) | {"extinction": "projected"} | more)
        return whole_scene(hg.build(record), pixels)

    return make


def angel(_: Path, pixels: int) -> hg.Scene:
    """The whole angel of figure 8, in colours of her own."""
    matter = hg.Reflectance(*OF_ANGEL, 1.5, hg.Spectrum.constant(0.8))
    found = dict.fromkeys(("skin", "cloth", "feather", "dielectric"), matter)
    camera = hg.Camera(pixels, pixels, (2.0 * pixels, 2.0 * pixels), (0.5 * pixels, 0.5 * pixels))
    return Cast(found, RESOLUTION, 1, extinction="projected").scene("figure_8_whole", camera, hg.silent)


FEW: dict[str, Callable[[Path, int], hg.Scene]] = {
    **{name: SCENES[name] for name in list(SCENES)[2:]},
    "hair": whole("hair", resolution=0.4),
    "primary feather that lets light through": whole("primary_through"),
    "skin": whole("skin"),
    "down": whole("down"),
    "satin": whole("satin"),
    "wool, 2/2 twill": whole("twill"),
    "the whole angel": angel,
}


class FewWalks(NamedTuple):
    """A solved picture in blocks, and walks through it. off: what truth has more in each block, of Y, and its variance;
    both are NaN where no matter is.
    """

    blocks: PictureBlocks
    walk: WalkThrough
    off: Array
    variance: Array

    @classmethod
    def of(cls, scene: hg.Scene, walks: int) -> FewWalks:
        """Of a scene; walks: a pixel, of the truth."""
        settings, cache = hg.Settings(RAYS, walks=0), SceneCache()
        image = hg.render(scene, settings, mode="full")
        blocks = PictureBlocks.of(image)
        walk = walks_here(scene, settings, cache, batches_and_bands(scene, settings)[1])
        sums = BlockSums(blocks, 0, blocks.matter.size)
        sums.shares = np.ones_like(sums.shares)
        sums.walk_on(walks * int(blocks.sizes[sums.chosen].sum()), walk)
        count, total = sums.walks.sum(axis=1), np.einsum("bfc,c->b", sums.total, blocks.y)
        off, variance = (np.full(blocks.matter.size, np.nan) for _ in range(2))
        off[sums.chosen] = total / count
        variance[sums.chosen] = (sums.square[:, -1] / count - (total / count) ** 2) / (count - 1)
        return cls(blocks, walk, off, variance)

    @property
    def mean(self) -> float:
        """True mean of Y of all light where matter is."""
        there = np.isfinite(self.off)
        return float(np.average((self.blocks.all_y + self.off)[there], weights=self.blocks.sizes[there]))

    def left(self, change: Array) -> tuple[float, float]:
        """What is off in the mean, and in blocks less the noise of the truth: squares; change: of the picture."""
        there = np.isfinite(self.off)
        off, sizes = (change - self.off)[there] / self.mean, self.blocks.sizes[there]
        square = off**2 - self.variance[there] / self.mean**2
        return float(np.average(off, weights=sizes)), float(np.average(square, weights=sizes))

    def mended(self, walks: int, draw: int, most: int) -> tuple[float, float]:
        """The same of a picture mended by so many walks a pixel, in all blocks or in `most`."""
        sums = BlockSums(self.blocks, draw, most)

        def others(pixels: Walked, numbers: Walked) -> NDArray[np.float32]:
            return self.walk(pixels, numbers + APART * (1 + draw))

        sums.walk_on(walks * sums.least, others)
        mender = Mender(sums)
        more = self.blocks.higher * (mender.factors(mender.fitted(mender.all)) - 1.0)
        return self.left(np.einsum("bc,c->b", in_blocks(more), self.blocks.y) / self.blocks.sizes)

    def row(self, title: str) -> dict[str, Any]:
        """Figures of the scene."""
        mean, square = self.left(np.zeros_like(self.off))
        every = self.blocks.matter.size
        ways = {str(walks): (walks, every) for walks in WALKS}
        ways["part"] = 1, max(int(self.blocks.matter.sum()) // PART, FOLDS)
        found = {
            name: [self.mended(walks, draw, most) for draw in range(DRAWS)] for name, (walks, most) in ways.items()
        }
        return {"title": title, "mean": mean, "blocks": math.sqrt(max(square, 0.0))} | {
            name: {
                "mean": float(np.mean([one for one, _ in each])),
                "blocks": math.sqrt(max(float(np.mean([two for _, two in each])), 0.0)),
            }
            for name, each in found.items()
        }


def main(
    recipes: tyro.conf.Positional[Path], out: Path, pixels: int = PIXELS, walks: int = TRUE_WALKS, only: str = ""
) -> None:
    """Solve every scene once, and mend it by draws of few walks.

    Args:
        recipes: folder of the recipes.
        out: folder to write; that of studies.full_error.
        pixels: a side of the pictures.
        walks: a pixel of the truth.
        only: a word in the titles of the scenes to render; the others stay as they are.
    """
    out.mkdir(parents=True, exist_ok=True)
    path = out / "few_walks.json"
    rows = {one["title"]: one for one in (hg.read_json(path)["rows"] if path.exists() else [])}
    for title, make in FEW.items():
        if only in title and title not in rows:
            print(title, flush=True)
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                rows[title] = FewWalks.of(make(recipes, pixels), walks).row(title)
            record = {"pixels": pixels, "walks": walks, "draws": DRAWS}
            hg.write_json(path, record | {"rows": [rows[name] for name in FEW if name in rows]})
    if (out / "results.json").exists():
        write_page(out)


if __name__ == "__main__":
    command(main)
