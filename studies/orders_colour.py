"""The colour of white cloth, measured with light of higher orders ignored and taken into account.

The photograph is a picture of mode path under a lamp in front: in life, all orders. A fibre's body colour is found by
which a picture of the same cloth is as bright in the mean: by mode march, in which light is linear in it, and by mode
full. What was found then predicts the cloth with the lamp behind, which is not looked at before.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import hagoromo as hg
from hagoromo.image.scene.modes import Mode

STEPS = 4  # of the secant by mode full
NEAR = 1e-3  # of the mean
SETTINGS = hg.Settings(4, walks=0)  # a secant wants no noise


def colour_row(
    front: hg.Scene, behind: hg.Scene, photographs: Mapping[str, hg.Image], truth: float
) -> tuple[dict[str, Any], dict[str, hg.Image]]:
    """Figures of both measurements and the pictures that they predict; truth: the body colour of the fibres.

    photographs: of the two scenes, which are of the same box, "front" and "behind".
    """
    scenes = {"front": front, "behind": behind}
    wanted = brightness(photographs["front"])
    row: dict[str, Any] = {"true": truth, "title": "white linen"}
    pictures = {f"{way}, in life": image for way, image in photographs.items()}
    ways: tuple[tuple[str, Mode], ...] = (("ignored", "march"), ("taken", "full"))
    for name, mode in ways:
        found = solved(front, mode, wanted)
        shown = min(found, largest(front))
        row[name] = {"colour": found, "shown": shown, "albedo": found / largest(front)}
        for way, scene in scenes.items():
            image = hg.render(coloured(scene, shown), SETTINGS, mode=mode)
            pictures[f"{way}, {name}"] = image
            row[name][way] = brightness(image) / brightness(photographs[way])
    return row, pictures


def coloured(scene: hg.Scene, colour: float) -> hg.Scene:
    """The scene with fibres of a grey body colour."""
    (box,) = scene.boxes
    materials = tuple(replace(m, body_colour=hg.Spectrum.constant(colour)) for m in box.materials)
    return replace(scene, boxes=(replace(box, materials=materials),))


def largest(scene: hg.Scene) -> float:
    """The body colour by which a fibre would send on all light, seen from where it sends on most."""
    (box,) = scene.boxes
    dark, grey = (
        replace(box.materials[0], body_colour=hg.Spectrum.constant(c)).directional_albedo() for c in (0.0, 0.5)
    )
    return 0.999 * float(np.min((1.0 - dark) / (2.0 * (grey - dark))))


def solved(scene: hg.Scene, mode: Mode, wanted: float) -> float:
    """The body colour by which a picture is as bright as wanted; mode full tries none above `largest`."""
    tried = [0.6, 0.8]
    seen = [brightness(hg.render(coloured(scene, colour), SETTINGS, mode=mode)) for colour in tried]
    if mode == "march":  # linear, so that it holds beyond what a fibre can be, too
        return float(tried[0] + (wanted - seen[0]) * (tried[1] - tried[0]) / (seen[1] - seen[0]))
    for _ in range(STEPS):
        slope = (seen[-1] - seen[-2]) / (tried[-1] - tried[-2])
        tried.append(float(min(tried[-1] + (wanted - seen[-1]) / slope, largest(scene))))
        seen.append(brightness(hg.render(coloured(scene, tried[-1]), SETTINGS, mode=mode)))
        if abs(seen[-1] - wanted) < NEAR * wanted or tried[-1] == tried[-2]:
            break
    return tried[-1]


def brightness(image: hg.Image) -> float:
    """Mean of Y."""
    return float(image.xyz()[..., 1].astype(float).mean())


def plot(path: Path, pictures: Mapping[str, hg.Image]) -> None:
    """In life, with higher orders ignored, and taken into account; lamp in front and behind, each row exposed alike."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 6.8), layout="constrained")
    axes: Any = figure.subplots(2, 3)
    titles = {"in life": "in life (path)", "ignored": "orders ignored (march)", "taken": "taken into account (full)"}
    for line, way in zip(axes, ("front", "behind"), strict=True):
        linear = {name: hg.srgb_from_xyz(pictures[f"{way}, {name}"].xyz()) for name in titles}
        white = 0.9 / max(float(np.percentile(linear["in life"], 99.5)), 1e-30)
        for axis, (name, title) in zip(line, titles.items(), strict=True):
            axis.imshow(hg.srgb_encode(np.clip(white * linear[name], 0.0, 1.0)))
            axis.set(xticks=[], yticks=[])
            axis.set_title(f"{title}, lamp {'in front' if way == 'front' else 'behind'}", fontsize=10)
    figure.savefig(path, dpi=110)
