"""The viewer without a browser: the first picture after a warm start, and pictures a second while the hand drags.

KERNEL's reference scene (a noisy ball in 256³ voxels under three lamps with shadow maps) while its camera goes along an
orbit, a lamp changes its strength, and a lamp moves. Each change is drawn as the viewer draws it: marched, exposed,
padded to the window and encoded. Medians over the changes; `cpu` is the time of all cores, for a machine that is busy;
`px` is the width of the first picture, which follows what the machine can do in time.

    python benchmarks/view.py [--size 512] [--changes 30]
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable

import cv2
import numpy as np
from preview import a_camera, reference_scene

from hagoromo_page.viewer.browser import JPEG_QUALITY, in_window
from hagoromo_page.viewer.scene_files import SceneFiles
from hagoromo_page.viewer.view_state import ViewState
from hagoromo_page.viewer.watcher import Desk, Watcher


class ReferenceFiles(SceneFiles):
    """The reference scene with the lamps of a state, without files."""

    def __init__(self, size: int) -> None:
        self.reference = reference_scene(size, size)

    def scene(self, state: ViewState):
        """As the desk asks for it."""
        import hagoromo as hg

        lamps = (hg.Lamp(lamp["position"], intensity=lamp["intensity"]) for lamp in state.tables["lamp"])
        return self.reference.with_lamps(*lamps), hg.Settings()


def drawn(watcher: Watcher, change: Callable[[int], None], k: int) -> tuple[float, float, int]:
    """Wall time and time of all cores [s] from a change to its first picture, and the picture's width [px]."""
    wall, cpu = time.perf_counter(), time.process_time()
    change(k)
    shown = watcher.next()
    assert shown is not None
    cv2.imencode(".jpg", in_window(shown.picture, 1.5), [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
    return time.perf_counter() - wall, time.process_time() - cpu, shown.picture.shape[1]


def main() -> None:
    """Print the table."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--size", type=int, default=512)
    options.add_argument("--changes", type=int, default=30)
    given = options.parse_args()
    places = [np.array(place, float).tolist() for place in ([2.0, 2.0, 2.0], [-2.0, 1.0, 2.0], [0.0, -2.5, 1.5])]
    state = ViewState({"camera": {}, "lamp": [{"position": place, "intensity": 27.0} for place in places]})
    desk = Desk(ReferenceFiles(given.size), state)
    watcher = Watcher(desk)

    def orbit(k: int) -> None:
        angle = 0.05 * (k + 1)
        eye = np.array([3.0 * np.sin(angle), 0.0, 3.0 * np.cos(angle)])
        watcher.look_from(a_camera(given.size, given.size, eye).world_to_camera)

    def strength(k: int) -> None:
        desk.edit(desk.state.with_value(("lamp", 0, "intensity"), 20.0 + k), "strength")

    def place(k: int) -> None:
        desk.edit(desk.state.with_value(("lamp", 0, "position", 0), 2.0 + 0.02 * k), "place")

    def last() -> None:
        while watcher.next() is not None:
            pass

    for change in (orbit, place):  # what is compiled is compiled now
        drawn(watcher, change, -3)
        last()
    print(f"{'change':24} {'first [s]':>10} {'cpu [s]':>9} {'a second':>9} {'px':>5} {'at rest [s]':>12}")
    for name, change in (("camera", orbit), ("strength of a lamp", strength), ("place of a lamp", place)):
        times = np.array([drawn(watcher, change, k) for k in range(given.changes)])
        begin = time.perf_counter()
        last()
        rest = time.perf_counter() - begin
        wall, cpu, width = np.median(times[len(times) // 3 :], axis=0)
        print(f"{name:24} {wall:10.3f} {cpu:9.3f} {1 / wall:9.1f} {width:5.0f} {rest:12.2f}")


if __name__ == "__main__":
    main()
