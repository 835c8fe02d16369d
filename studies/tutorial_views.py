"""The tutorial of many views as it stands on its page, and its picture.

    python -m studies.tutorial_views --out out/tutorial_views

Needs a shell, and `hagoromo` on the path.
"""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

from PIL import Image

from studies.command import command

PAGE = Path(__file__).parents[1] / "docs" / "tutorial_views.md"
EDGE = 320  # px of each picture of the row
PHOTOGRAPHS, FRAMES = ("view05", "view22"), (6, 12)  # of the row


def shell_blocks(page: Path) -> list[str]:
    """The blocks of a page that are for a shell, those of its notes among them."""
    text = re.sub(r"^> ?", "", page.read_text(encoding="utf-8"), flags=re.MULTILINE)
    return re.findall(r"^```sh\n(.*?)^```", text, re.DOTALL | re.MULTILINE)


def tutorial_views(out: Path) -> None:
    """Run every command of the page in the folder `out`, and put pictures of the way in a row."""
    out.mkdir(parents=True, exist_ok=True)
    for block in shell_blocks(PAGE):
        subprocess.run(["bash", "-euo", "pipefail", "-c", block], cwd=out, check=True)
    row = [out / "around" / "photographs" / f"{name}.jpg" for name in PHOTOGRAPHS]
    row += [out / "around" / "masks" / f"{PHOTOGRAPHS[0]}.png", out / "evening.png"]
    row += [out / "turning_frames" / f"frame_{number:05d}.png" for number in FRAMES]
    picture = Image.new("RGB", (EDGE * len(row), EDGE))
    for number, path in enumerate(row):
        with Image.open(path) as one:
            picture.paste(one.convert("RGB").resize((EDGE, EDGE)), (EDGE * number, 0))
    picture.save(out / "tutorial_views.jpg", quality=90)


if __name__ == "__main__":
    command(tutorial_views)
