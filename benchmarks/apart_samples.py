"""Apart samples: what `apart.py` reads here and in a process apart; a module, so that both can find its functions."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

Arrays = Mapping[str, Any]


def nothing(path: Path) -> Arrays:
    """One number: what asking costs."""
    return {"a": np.zeros(1)}


def lines_of_exr(path: Path) -> Arrays:
    """An EXR in lines, which our own code and Python's zlib read."""
    from hagoromo.files.exr import read_exr

    return read_exr(path)[0]


def numbers_behind_a_header(path: Path) -> Arrays:
    """NRRD and the like, which our own code and Python's zlib read."""
    from hagoromo.files.volume_file import read_volume

    return {"values": read_volume(path).values}


def chunk_of_zarr(path: Path) -> Arrays:
    """A chunk of Zarr, Zstandard by numcodecs, whose size is checked first."""
    from hagoromo.files.zarr_codecs import unpacked

    return {"values": np.frombuffer(unpacked("zstd", path.read_bytes(), 1 << 21, True, {}), np.float32)}


def exif(path: Path) -> Arrays:
    """The settings of an exposure, by tifffile."""
    from hagoromo.files.exif import read_exif

    return {"iso": np.array(read_exif(path).iso or 0.0)}
