"""Real captures of fixed unknown light, made by others: photographs and cameras as their files state them.

Eight bits are read as sRGB. No lamp is stated anywhere.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np

import hagoromo as hg
from hagoromo.files.png import read_png
from hagoromo.photograph.gather import gather

HEAD_SCALE = 0.2  # of the photographs, 800², from those that the poses were found with, 4000²


def middlebury(file: Path) -> hg.Capture:
    """The photographs beside a `_par.txt`; the background is dark, and there are no masks."""
    return gather(hg.read_views(file), file.parent, "srgb")


def ethiopian_head(folder: Path) -> hg.Capture:
    """Photographs with masks, and poses as of LLFF: rows of 3 × 5, camera-to-world, axes down, right, back."""
    files = sorted((folder / "images").iterdir())
    rows = np.loadtxt(folder / "poses_bounds.csv", delimiter=",")[:, :15].reshape(-1, 3, 5)
    views: dict[str, hg.Camera] = {}
    for file, row in zip(files, rows, strict=True):
        height, width, focal = HEAD_SCALE * row[:, 4]
        pose = np.eye(4)
        pose[:3, :4] = np.stack([row[:, 1], row[:, 0], -row[:, 2], row[:, 3]], axis=1)
        camera = hg.Camera(round(width), round(height), (focal, focal), (width / 2, height / 2))
        views[file.name] = camera.with_pose(np.linalg.inv(pose))
    capture = gather(views, folder / "images", "srgb")
    masked = []
    for photograph in capture.photographs:
        mask = read_png(folder / "masks" / f"{photograph.name}.png")
        mask = mask.reshape(*photograph.mask.shape, -1).max(axis=2) > 127
        masked.append(replace(photograph, silhouette=mask, mask=photograph.mask & mask))
    return replace(capture, photographs=tuple(masked))


REAL: dict[str, Callable[[Path], hg.Capture]] = {
    "dino_48": lambda data: middlebury(data / "dino_48" / "dino_par.txt"),
    "middlebury_dino": lambda data: middlebury(data / "middlebury_dino" / "dinoSR_par.txt"),
    "ethiopian_head": lambda data: ethiopian_head(data / "ethiopian_head"),
    "nerf_lego_30": lambda data: hg.load_capture(data / "nerf_lego_30" / "transforms_train.json"),
    "ngp_fox": lambda data: hg.load_capture(data / "ngp_fox"),
}
