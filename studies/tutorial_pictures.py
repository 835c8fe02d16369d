"""The pictures of the tutorials: the dome's page in a browser, and the spectra of skin, by the commands of their pages.

    python -m studies.tutorial_pictures --out out/tutorials

Leaves: tutorial_dome.jpg and tutorial_skin.png, and the folders that the commands wrote. Prints how far the normals of
the dome's object are from the truth.
"""

from __future__ import annotations

import re
import shlex
import shutil
import subprocess
import sys
from contextlib import chdir
from glob import glob
from pathlib import Path

import numpy as np

import hagoromo as hg
from studies.command import command
from studies.dome import dome
from studies.published import picture
from studies.skin import skin

DOCS = Path(__file__).parents[1] / "docs"
LAMPS, WIDTH = 48, 240  # of the dome, as on its page


def tutorial_pictures(out: str | Path, force: bool = False) -> Path:
    """Run both pages in the folder `out`; gives it."""
    with hg.whole_folder(out, force) as home, chdir(home):
        dome("dome", LAMPS, WIDTH)
        skin("skin", 0)
        for page in ("tutorial_dome.md", "tutorial_skin.md"):
            for command in commands(DOCS / page):
                subprocess.run([sys.executable, "-m", "hagoromo", *command], check=True)
        picture(Path("page.html"), Path("tutorial_dome.jpg"))
        shutil.copyfile("spectra/spectra.png", "tutorial_skin.png")
    return Path(out)


def normals_off(home: Path) -> float:
    """Median angle [°] between the measured normals of the dome's object and the true ones, in a folder of the page."""
    layers = [hg.read_exr(home / path / "normals.exr")[0] for path in ("measured", "dome/truth")]
    found, true = (np.stack([one[f"N.{axis}"] for axis in "XYZ"], axis=2) for one in layers)
    both = (np.linalg.norm(found, axis=2) > 0.5) & (np.linalg.norm(true, axis=2) > 0.5)
    return float(np.median(np.degrees(np.arccos(np.clip(np.sum(found * true, axis=2)[both], -1.0, 1.0)))))


def commands(page: Path) -> list[list[str]]:
    """The arguments of each `hagoromo` command of a page that stands outside of a quotation."""
    blocks = re.findall(r"^```sh\n(.*?)^```", page.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    lines = [shlex.split(line) for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    found = [line[1:] for line in lines if line[:1] == ["hagoromo"]]
    return [[one for word in line for one in (sorted(glob(word)) if "*" in word else [word])] for line in found]


def main(out: Path, force: bool = False) -> None:
    """Make the pictures.

    Args:
        out: where to write the result.
        force: replace an existing result.
    """
    home = tutorial_pictures(out, force)
    print(f"normals of the dome's object: off by {normals_off(home):.2f}° (median)")
    print(f"wrote {home}")


if __name__ == "__main__":
    command(main)
