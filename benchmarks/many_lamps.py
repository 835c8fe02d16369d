"""Time of `measure` under many far lamps: glossy domes, simulated; and how near the normals come.

    python benchmarks/many_lamps.py [--lamps 96] [--size 154]

A line of JSON each: CPU seconds of this process (user and system), mean error of normals [°], and the share of pixels
of which the squared error is below three times the variance that is stated.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence

import numpy as np

import hagoromo as hg
from studies.command import command
from studies.glossy_objects import glossy_object


def main(lamps: int = 96, size: int = 154, objects: Sequence[str] = ("glaze", "waxed")) -> None:
    """Measure each of some objects.

    Args:
        lamps: of each object, one a photograph.
        size: of the photographs, width and height [px].
        objects: of `studies.glossy_objects`.
    """
    for name in objects:
        capture, normals = glossy_object(name, size=size, lamps=lamps)
        begin = time.process_time()
        found = hg.measure(capture)
        seconds = time.process_time() - begin
        assert found.normal_variance is not None
        there = np.isfinite(found.normal_variance) & (np.abs(normals).sum(axis=2) > 0.0)
        cosine = np.clip((found.normals * normals).sum(axis=2), -1.0, 1.0)[there]
        angle = np.arccos(cosine)
        held = angle**2 < 3.0 * found.normal_variance[there]
        row = {"object": name, "lamps": lamps, "pixels": int(there.sum()), "cpu_s": round(seconds, 1)}
        print(json.dumps(row | {"error_deg": round(float(np.degrees(angle).mean()), 4), "held": float(held.mean())}))


if __name__ == "__main__":
    command(main)
