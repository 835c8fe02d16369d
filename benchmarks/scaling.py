"""How the time of a frame grows: with the resolution of the same matter, with pixels, lamps and boxes.

A fuzzy shell (shells.py) is rendered by `hagoromo.render`, everything made anew with the lamps moved each frame: the
boxes' tables, a shadow map of 1024² rays a lamp, the picture, copied to the host. Written to out/bench/scaling.json.

    python benchmarks/scaling.py [--rounds 5] [--finest 2048]
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import count, product
from typing import Any

import numpy as np
from shells import FUZZY, camera, lamps
from steps import steps_of
from turns import Frame, in_turn, medians, options, record

import hagoromo as hg
from hagoromo.image.render import Settings

PIXELS, LAMPS, VOXELS = 512, 3, 512  # where they are not what is varied
MAPPED, UNSHADED = Settings(shadow_resolution=1024), Settings(shadows="none")
LONGEST = 10.0  # of one setting's frames, after which no further round begins [s]
GROWTH = 3.0  # of the next number of boxes: a frame that would take longer than LONGEST is left out
RESOLUTIONS = (128, 256, 512, 1024, 2048)
PICTURES = (128, 256, 512, 1024, 2048)
LAMP_COUNTS = (1, 2, 4, 8, 16)
CUTS = ((1, 1, 1), (2, 1, 1), (2, 2, 1), (2, 2, 2), (4, 2, 2), (4, 4, 2))  # boxes along x, y and z


def main() -> None:
    """Run the four studies, one file of figures."""
    parser = options(__doc__, 5)
    parser.add_argument("--finest", type=int, default=RESOLUTIONS[-1], help="voxels a side; 2048 takes 4 GiB")
    asked = parser.parse_args()
    found: dict[str, list[dict[str, Any]]] = {"resolution": [], "pixels": [], "lamps": [], "boxes": []}

    def add(study: str, boxes: list[hg.VolumeBox], what: dict[str, Any], side: int = PIXELS, lit: int = LAMPS) -> None:
        row = what | medians(in_turn(frames(boxes, side, lit), asked.rounds, LONGEST))
        found[study].append(row)
        print(study, row, flush=True)

    for voxels in (n for n in RESOLUTIONS if n <= asked.finest):
        box = FUZZY.box(voxels)
        what = {"voxels": voxels, "lattice": voxels**3, "kept_bricks": box.bricks.kept}
        add("resolution", [box], what | steps_of([box], camera(PIXELS)))
    box = FUZZY.box(VOXELS)
    for side in PICTURES:
        add("pixels", [box], {"pixels": side**2}, side=side)
    for lit in LAMP_COUNTS:
        add("lamps", [box], {"lamps": lit}, lit=lit)
    for parts in CUTS:
        boxes, places = int(np.prod(parts)), product(*(range(n) for n in parts))
        arranged = {
            "side by side": lambda places=places, parts=parts: [FUZZY.part(VOXELS, parts, place) for place in places],
            "overlapped": lambda boxes=boxes: [replace(box, tau=box.tau / boxes)] * boxes,
        }
        for how, made in arranged.items():
            before = [row["mapped_s"] for row in found["boxes"] if row["arranged"] == how]
            if not before or GROWTH * before[-1] < LONGEST:
                add("boxes", made(), {"boxes": boxes, "arranged": how})
    record("scaling", found)


def frames(boxes: Sequence[hg.VolumeBox], pixels: int, lit: int) -> dict[str, Frame]:
    """Frames with shadow maps and without, in seconds; the lamps stand elsewhere in each."""
    turn, seen = count(), camera(pixels)

    def frame(settings: Settings) -> Any:
        hg.render(hg.Scene(seen, lamps(lit, 0.02 * next(turn)), tuple(boxes)), settings)

    return {"mapped_s": lambda: frame(MAPPED), "unshaded_s": lambda: frame(UNSHADED)}


if __name__ == "__main__":
    main()
