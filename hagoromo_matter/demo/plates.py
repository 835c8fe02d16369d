"""Plates: the figures of a finished demo as JPEG, and the page that shows them: docs/figures.md."""

from __future__ import annotations

import argparse
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.files.record import read_json
from hagoromo.files.whole import whole_file
from hagoromo_matter.demo.figures import PAPER_FIGURES

PLATE_JPEG_QUALITY = 92
PLATES_INTRODUCTION = """# Figures 6, 7 and 8 of the paper

Made by `make figures` (`hagoromo demo --size full`): an angel and a nun, 270 mm high, all of volume boxes, with the
reflectances that the demo measures from simulated photographs. Three white point lamps: a key high on the left, a weak
fill, a rim from behind; the Canon EOS Kiss Digital with its 55 mm lens. Light is scattered once. With light of all
orders and in other sizes, such as 4K: `make figures MODE=path PIXELS=3840`, see [Stills](stills.md).
"""


FILM = "figure_8_turning"  # of `python -m studies turning`, see `turning.py`
FILM_TEXT = f"""<video controls loop muted playsinline preload="none" width="810" poster="figures/{FILM}.jpg">
<source src="figures/{FILM}.webm" type="video/webm"><a href="figures/{FILM}.webm">Figure 8 as a film</a></video>

*Figure 8 as a film of 8 s, 1620 × 1080 pixels, made by `python -m studies turning`: each figure turns once before
camera and lamps, in boxes of half the resolution.*
"""


def write_plates(demo: Path, docs: Path) -> None:
    """The pictures of the demo in the folder `demo` as `docs`/figures/*.jpg, and the page `docs`/figures.md."""
    import cv2

    size = read_json(demo / "results.json")["size"]
    parts = [PLATES_INTRODUCTION, f"Resolution {size['resolution']:g}, {size['figure_samples']} rays a pixel.\n"]
    for name in size["figures"]:
        picture = read_png(demo / "figures" / f"{name}.png")
        made, code = cv2.imencode(".jpg", picture[..., 2::-1], [cv2.IMWRITE_JPEG_QUALITY, PLATE_JPEG_QUALITY])
        if not made:
            raise InputError(f"{name} of {demo} cannot be written as JPEG: render it again")
        with whole_file(docs / "figures" / f"{name}.jpg", force=True) as path:
            path.write_bytes(code.tobytes())
        number, caption = name.split("_")[1], PAPER_FIGURES[name].caption
        parts.append(f"![{caption}](figures/{name}.jpg)\n\n*Figure {number}. {caption}*\n")
    if (docs / "figures" / f"{FILM}.webm").exists():
        parts.append(FILM_TEXT)
    with whole_file(docs / "figures.md", force=True) as page:
        page.write_text("\n".join(parts), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("demo", type=Path, help="folder of a finished demo")
    parser.add_argument("docs", type=Path, help="folder of the page")
    write_plates(**vars(parser.parse_args()))
