"""Errors of a solved surface, and their files: variance.exr has the whole and the own, shared_errors.exr the shared.

    variance.exr        normal, distance: all errors of a pixel [rad², m²]; own.normal, own.distance: those that are
                        independent between pixels; sums.normal: those as they count in sums over pixels, where normals
                        were smoothed
    shared_errors.exr   NN.N.X, NN.N.Y, NN.N.Z [rad], NN.distance [m] of mode NN = 01, 02, …

Of photographs that were solved in tiles the modes are those of squares of pixels, as many as fit in whole.

The errors that pixels share are Σ x_j mode_j, with independent x_j of variance 1: that of any mean over pixels is the
sum of the squares of the modes' means, beside its own.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr

VARIANCE, SHARED_ERRORS = "variance.exr", "shared_errors.exr"
UNKNOWN_VARIANCE = np.finfo(np.float32).max  # stands in variance.exr for an infinite one; older files have infinity
OWN = "own."
SUMMED = "sums.normal"
MOST_MODES = 99
Map = NDArray[np.floating]


@dataclass(frozen=True, eq=False)
class SharedErrors:
    """The errors that all pixels of a solved surface share, mode by mode, each of variance 1; 0 where unknown.

    normals: (m, h, w, 3) changes of the normals [rad], world axes. distance: (m, h, w) changes of the distance [m].
    """

    normals: NDArray[np.float32]
    distance: NDArray[np.float32]

    @property
    def variances(self) -> tuple[Map, Map]:
        """(h, w) of the normals [rad²] and of the distance [m²]."""
        return np.sum(self.normals**2, axis=(0, 3)), np.sum(self.distance**2, axis=0)

    def of_size(self, shape: tuple[int, ...]) -> SharedErrors:
        """The same for a picture of `shape` (h, w), of whose squares of pixels these are. `InputError` for another."""
        normals, distance = (_of_squares(one, shape) for one in (self.normals, self.distance))
        return SharedErrors(normals, distance)

    def variance_of_mean(self, weights: Map) -> tuple[float, float]:
        """That of the mean, with `weights` (h, w), of normals [rad², a sum over the axes] and of distances [m²]."""
        share = weights / weights.sum()
        normals, distances = np.einsum("mhwi,hw->mi", self.normals, share), np.einsum("mhw,hw->m", self.distance, share)
        return float(np.sum(normals**2)), float(np.sum(distances**2))


def write_errors(
    home: Path, variances: tuple[Map | None, Map | None], shared: SharedErrors | None, summed: Map | None = None
) -> None:
    """Write variance.exr and, where there are shared errors, shared_errors.exr; nothing without variances.

    summed: `summed_variance` of a Measurement.
    """
    normal, distance = variances
    if normal is None or distance is None:
        return
    channels = {"normal": normal, "distance": distance}
    if shared is not None:
        for (name, whole), part in zip(tuple(channels.items()), shared.variances, strict=True):
            channels[OWN + name] = np.maximum(whole - _of_squares(part[None], whole.shape)[0], 0.0)
        write_exr(home / SHARED_ERRORS, _channels_of(shared))
    if summed is not None:
        channels[SUMMED] = summed
    write_exr(home / VARIANCE, {name: np.minimum(one, UNKNOWN_VARIANCE) for name, one in channels.items()})


def read_shared_errors(path: Path, shape: tuple[int, ...]) -> SharedErrors | None:
    """What `write_errors` wrote, for maps of `shape` (h, w); None where there is no file."""
    if not path.is_file():
        return None
    layers, _ = read_exr(path)
    count = len(layers) // 4
    names = [[f"{j + 1:02d}.{part}" for part in ("N.X", "N.Y", "N.Z", "distance")] for j in range(count)]
    if not 0 < count <= MOST_MODES or {n for mode in names for n in mode} != set(layers):
        raise InputError(f"{path} must have channels 01.N.X, 01.N.Y, 01.N.Z, 01.distance, 02.N.X, …: measure again")
    modes = np.stack([np.stack([layers[name] for name in mode], axis=2) for mode in names])
    try:
        return SharedErrors(modes[..., :3], modes[..., 3]).of_size(shape)
    except InputError:
        raise InputError(f"{path} is not of the size of labels.png: measure again") from None


def _of_squares(maps: Map, shape: tuple[int, ...]) -> Map:
    """Maps (m, h, w, …) of squares of pixels for a picture of `shape`: of each pixel that of its square, or, at the
    edge, of the last one.
    """
    height, width = maps.shape[1:3]
    if (height, width) == shape:
        return maps
    sides = range(1, max(shape) + 1)
    side = next((n for n in sides if (shape[0] // n, shape[1] // n) == (height, width)), None)
    if side is None:
        raise InputError(f"maps of {width} × {height} squares do not fit a picture of {shape[1]} × {shape[0]} pixels")
    rows, columns = (np.minimum(np.arange(n) // side, most - 1) for n, most in zip(shape, (height, width), strict=True))
    return maps[:, rows[:, None], columns]


def _channels_of(shared: SharedErrors) -> dict[str, Map]:
    found = {}
    for j, (turn, moved) in enumerate(zip(shared.normals, shared.distance, strict=True)):
        found |= {f"{j + 1:02d}.N.{axis}": turn[..., i] for i, axis in enumerate("XYZ")}
        found[f"{j + 1:02d}.distance"] = moved
    return found
