"""The surface that a measurement wrote to its folder: materials, labels, normals, points and body colours per pixel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, of_folder
from hagoromo.files.exr import read_exr
from hagoromo.files.png import read_png
from hagoromo.photograph.points_file import read_points
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.material.materials_file import read_materials

ERROR_PREFIX = "error."  # prefix of the channels of standard errors


@dataclass(frozen=True, eq=False)
class MeasuredSurface:
    """A surface of h × w pixels in C channels, as its files have it.

    materials; labels: (h, w) index into them, −1 unknown. normals: (h, w, 3) unit, world axes. points: (h, w, 3) [m].
    body: (h, w, C) α c_b of each pixel [1/sr]; body_error: its standard error. Vectors and colours are 0 where unknown;
    points, body and body_error are None where the folder does not have them.
    """

    materials: tuple[MaterialEstimate, ...]
    labels: NDArray[np.int64]
    normals: NDArray[np.float32]
    points: NDArray[np.floating] | None
    body: NDArray[np.float32] | None
    body_error: NDArray[np.float32] | None


def read_surface(folder: str | Path) -> MeasuredSurface:
    """The surface in materials.json, labels.png, normals.exr and, where they exist, points.exr and body.exr.

    Channels of body.exr are in the order R, G, B, or else in that of their names ("0", "1", …).
    `InputError` where a file is missing or damaged, or the files do not go together.
    """
    home = Path(folder)
    materials = read_materials(of_folder(home, "materials.json", "a folder that `hagoromo measure` wrote"))
    labels = read_png(inside(home, "labels.png")).astype(np.int64) - 1
    if labels.ndim != 2 or labels.max() >= len(materials):
        raise InputError(f"{home / 'labels.png'} has labels up to {labels.max() + 1}: materials are {len(materials)}")
    at_points, at_body = inside(home, "points.exr"), inside(home, "body.exr")
    normals = _normals(inside(home, "normals.exr"))
    points = read_points(at_points) if at_points.is_file() else None
    body, body_error = _body(at_body) if at_body.is_file() else (None, None)
    surface = MeasuredSurface(materials, labels, normals, points, body, body_error)
    channels = {"normals": 3, "points": 3, "body": len(materials[0].body_colour), "body_error": 0} if materials else {}
    for name in channels:
        part = getattr(surface, name)
        if part is not None and (part.shape[:2] != labels.shape or part.shape[2] != (channels[name] or part.shape[2])):
            raise InputError(f"{home}: {name} of shape {part.shape} for labels of {labels.shape}: measure again")
    return surface


def colour_channels(names: set[str]) -> tuple[str, ...]:
    """`names` of the channels of a colour, in order."""
    return tuple("RGB") if names == set("RGB") else tuple(sorted(names, key=lambda name: (len(name), name)))


def _body(path: Path) -> tuple[NDArray[np.float32], NDArray[np.float32] | None]:
    """Values and, where there are any, their standard errors."""
    layers, _ = read_exr(path)
    names = colour_channels({name for name in layers if "." not in name})
    if not names:
        raise InputError(f"{path} has no channel of a colour: it has {', '.join(layers)}: measure again")
    values = np.stack([layers[name] for name in names], axis=2)
    errors = [layers[ERROR_PREFIX + name] for name in names if ERROR_PREFIX + name in layers]
    return values, np.stack(errors, axis=2) if len(errors) == len(names) else None


def _normals(path: Path) -> NDArray[np.float32]:
    layers, _ = read_exr(path)
    names = [f"N.{axis}" for axis in "XYZ"]
    if not set(names) <= set(layers):
        raise InputError(f"{path} must have the channels {', '.join(names)}: it has {', '.join(layers)}")
    return np.stack([layers[name] for name in names], axis=2)
