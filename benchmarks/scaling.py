"""How the time of a frame grows: with the resolution of the same matter, with pixels, lamps and boxes.

A fuzzy shell (shells.py) is rendered by `hagoromo.render`, everything made anew with the lamps moved each frame: the
boxes' tables, a shadow map of 1024² rays a lamp, the picture, copied to the host. All settings of a study take turns.
Written to out/bench/scaling.json.

    python benchmarks/scaling.py [--rounds 3] [--finest 2048]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count, product
from typing import Any

import numpy as np
from shells import FUZZY, camera, lamps
from steps import steps_of
from turns import Frame, in_turn, medians, options, record, seconds

import hagoromo as hg
from hagoromo.image.scene.settings import Settings

PIXELS, LAMPS, VOXELS = 512, 3, 512  # where they are not what is varied
MAPPED, UNSHADED = Settings(shadow_resolution=1024), Settings(shadows="none")
RESOLUTIONS = (128, 256, 512, 1024, 2048)
PICTURES = (128, 256, 512, 1024, 2048)
LAMP_COUNTS = (1, 2, 4, 8, 16)
CUTS = ((1, 1, 1), (2, 1, 1), (2, 2, 1), (2, 2, 2), (4, 2, 2), (4, 4, 2))  # boxes along x, y and z
LONGEST, GROWTH = 10.0, 3.0  # s, of a frame; one of twice the boxes is taken to need GROWTH times as long, and left out


def main() -> None:
    """Run the four studies, one file of figures."""
    parser = options(__doc__, 3)
    parser.add_argument("--finest", type=int, default=RESOLUTIONS[-1], help="voxels a side; 2048 takes 4 GiB")
    asked = parser.parse_args()
    found = {
        "resolution": resolutions(asked.finest).rows(asked.rounds),
        "pixels": pictures().rows(asked.rounds),
        "lamps": lamp_counts().rows(asked.rounds),
        "boxes": box_counts().rows(asked.rounds),
    }
    record("scaling", found)


class ScalingStudy:
    """Settings of one study, each with what it is and its frames."""

    def __init__(self) -> None:
        self.settings: list[tuple[dict[str, Any], dict[str, Frame]]] = []

    def add(self, what: dict[str, Any], boxes: Sequence[hg.VolumeBox], pixels: int = PIXELS, lit: int = LAMPS) -> None:
        """One more setting."""
        self.settings.append((what, frames(boxes, pixels, lit)))

    def rows(self, rounds: int) -> list[dict[str, Any]]:
        """What every setting is, and the median times of its frames [s]."""
        turns = {(k, name): f for k, (_, own) in enumerate(self.settings) for name, f in own.items()}
        taken = medians(in_turn(turns, rounds, 4 * LONGEST))
        rows = [what | {name: taken[k, name] for name in own} for k, (what, own) in enumerate(self.settings)]
        print(*rows, sep="\n", flush=True)
        return rows


def frames(boxes: Sequence[hg.VolumeBox], pixels: int, lit: int) -> dict[str, Frame]:
    """Frames with shadow maps and without; the lamps stand elsewhere in each."""
    turn, seen = count(), camera(pixels)

    def frame(settings: Settings) -> Any:
        hg.render(hg.Scene(seen, lamps(lit, 0.02 * next(turn)), tuple(boxes)), settings)

    return {"mapped_s": lambda: frame(MAPPED), "unshaded_s": lambda: frame(UNSHADED)}


def resolutions(finest: int) -> ScalingStudy:
    """The same shell in finer and finer voxels."""
    study = ScalingStudy()
    for voxels in (n for n in RESOLUTIONS if n <= finest):
        box = FUZZY.box(voxels)
        what = {"voxels": voxels, "lattice": voxels**3, "kept_bricks": box.bricks.kept}
        study.add(what | steps_of([box], camera(PIXELS), lamps(LAMPS)), [box])
    return study


def pictures() -> ScalingStudy:
    """The same shell in more and more pixels."""
    study, box = ScalingStudy(), FUZZY.box(VOXELS)
    for side in PICTURES:
        study.add({"pixels": side**2} | steps_of([box], camera(side), lamps(LAMPS)), [box], pixels=side)
    return study


def lamp_counts() -> ScalingStudy:
    """The same shell under more and more lamps."""
    study, box = ScalingStudy(), FUZZY.box(VOXELS)
    for lit in LAMP_COUNTS:
        study.add({"lamps": lit}, [box], lit=lit)
    return study


def box_counts() -> ScalingStudy:
    """The same shell in more and more boxes: cut, side by side; and overlapped, each with a part of its density."""
    study, whole, longest = ScalingStudy(), FUZZY.box(VOXELS), 0.0
    for parts in CUTS:
        boxes, places = int(np.prod(parts)), product(*(range(n) for n in parts))
        cut = [FUZZY.part(VOXELS, parts, place) for place in places]
        study.add({"boxes": boxes, "arranged": "side by side"}, cut)
        if GROWTH * longest < LONGEST:
            study.add({"boxes": boxes, "arranged": "overlapped"}, [replace(whole, tau=whole.tau / boxes)] * boxes)
            frame = study.settings[-1][1]["mapped_s"]
            longest = min(seconds(frame), seconds(frame))  # the first one may compile
    return study


if __name__ == "__main__":
    main()
