"""Stack lamps: the lamps that a weight stack is rendered under: evenly at first, then where the page errs most."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.progress import Progress, part_of, silent
from hagoromo.transport.palette import distinct
from hagoromo_page.publication.colours import PageColours, stack_colours
from hagoromo_page.publication.lit import hemisphere
from hagoromo_page.publication.stack_page import packed_for_page
from hagoromo_page.publication.weight_stack import WeightStack, weight_stack

FEWEST_LAMPS, MOST_LAMPS = 8, 512
CANDIDATES = 4096  # directions among which lamps are added
ROUND = 0.5  # of what is left of the progress, for each round
Array = NDArray[np.float64]


def stack_under(
    scene: Scene, lamps: int, error: float | None, settings: Settings, progress: Progress = silent
) -> tuple[WeightStack, PageColours]:
    """`scene` under `lamps` far lamps, evenly over the hemisphere before its camera, and the colours of its page.

    error: of 255; lamps are added, twice as many in every round, where each is predicted worst from the others, until
    their root mean square is below it or there are MOST_LAMPS. None: none are added. `InputError` for a number of
    lamps or an error that cannot be, and where the camera sees no matter.
    """
    if not FEWEST_LAMPS <= lamps <= MOST_LAMPS:
        raise InputError(f"{lamps} lamps over the hemisphere: give {FEWEST_LAMPS} to {MOST_LAMPS}")
    if error is not None and not 0.0 < error < 255.0:
        raise InputError(f"an error of {error:g} of 255 between the lamps: give a number above 0, such as 2")
    share = 1.0 if error is None else ROUND
    stack = weight_stack(scene, hemisphere(lamps, 0.0), settings, part_of(progress, 0.0, share))
    if not stack.known.any():
        raise InputError("the camera sees no matter: turn it towards the scene")
    spectra = distinct([one.spectrum for one in scene.lamps])
    colours = stack_colours(stack.colours, scene.camera.response, spectra)
    while error is not None and len(stack.directions) < MOST_LAMPS:
        packed = packed_for_page(stack, colours)
        if packed.error_between <= error:
            break
        count = min(len(stack.directions), MOST_LAMPS - len(stack.directions))
        added = directions_to_add(stack.directions, packed.lamp_errors, count)
        share, begin = ROUND * (1.0 - share), share
        stack = weight_stack(scene, added, settings, part_of(progress, begin, share), stack)
        share += begin
    return stack, colours


def directions_to_add(directions: Array, errors: Array, count: int) -> Array:
    """(count, 3) directions, each where distance to the nearest lamp times the error of that lamp is largest.

    directions: (N, 3) of the lamps, unit. errors: (N,) of each as predicted from the others. A direction that is added
    has the error of its nearest lamp.
    """
    candidates = hemisphere(CANDIDATES, 0.0)
    apart = np.linalg.norm(candidates[:, None] - directions[None], axis=2)
    nearest = apart.argmin(axis=1)
    distance, error = apart.min(axis=1), np.maximum(errors, 1e-3 * max(float(errors.max()), 1e-30))[nearest]
    chosen = np.empty((count, 3))
    for k in range(count):
        best = int(np.argmax(distance * error))
        chosen[k] = candidates[best]
        apart_of_new = np.linalg.norm(candidates - chosen[k], axis=1)
        error = np.where(apart_of_new < distance, error[best], error)
        distance = np.minimum(distance, apart_of_new)
    return chosen
