"""The picture of docs/howto/blender.md: a ball that is dressed with skin in Blender, rendered there by both programs.

    make cycles && python -m studies blender

Leaves in out/blender: blender.jpg, and what `blender_session.py` leaves in its folder `dressed`.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import matplotlib
import numpy as np

import hagoromo as hg
from studies.command import command

PYTHON = Path(".venv/cycles/bin/python")
ROWS = (("light of the first order", "march", "cycles_1"), ("light of all orders", "full", "cycles"))


def blender(out: str | Path, force: bool = False) -> Path:
    """Render the dressed ball in Blender and plot the pictures; gives the folder. `InputError` without bpy."""
    if not PYTHON.exists():
        raise hg.InputError(f"{PYTHON} is not here: `make cycles` brings Blender as a module")
    with hg.whole_folder(out, force) as home:
        folder = home / "dressed"
        folder.mkdir()
        environment = {**os.environ, "HAGOROMO_COMMAND": str(Path(sys.executable).with_name("hagoromo"))}
        session = [str(PYTHON), str(Path(__file__).with_name("blender_session.py")), "dressed", str(folder)]
        subprocess.run(session, env=environment, check=True)
        plotted(folder, home / "blender.jpg")
    return Path(out)


def plotted(folder: Path, out: Path) -> None:
    """Both programs' pictures side by side, one exposure for all, and their means over the picture."""
    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, 2, figsize=(9.6, 7.6), layout="constrained")
    white = float(np.percentile(np.load(folder / "full.npy"), 99.5))
    for line, (title, ours, theirs) in zip(axes, ROWS, strict=True):
        for axis, program, name in zip(line, ("Hagoromo", "Cycles, 64 samples"), (ours, theirs), strict=True):
            values = np.load(folder / f"{name}.npy")
            axis.imshow(hg.srgb_encode(np.clip(values / white, 0.0, 1.0)))
            axis.set_title(f"{program}: {title}; mean {values.mean():.4f}", fontsize=10)
            axis.set_axis_off()
    figure.savefig(out, dpi=100, pil_kwargs={"quality": 85})
    plt.close(figure)


def main(out: Path = Path("out/blender"), force: bool = False) -> None:
    """Make the picture. out: folder of results. force: replace it."""
    blender(out, force)


if __name__ == "__main__":
    command(main)
