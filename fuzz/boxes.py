"""Good samples of Zarr: volume boxes, shells, and arrays of other programs with every codec."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance

DENSITY = (np.random.default_rng(3).random((9, 6, 7)) > 0.6).astype(np.float32)


def box(folder: Path) -> None:
    """A box with axes."""
    from hagoromo.volume.box import VolumeBox
    from hagoromo.volume.store.box_store import save_box

    axis = np.broadcast_to(np.array([0, 0, 1], np.float32), (*DENSITY.shape, 3))
    matter = Reflectance(0.2, 0.5, 0.2, 1.5, Spectrum.constant(0.8))
    save_box(VolumeBox.from_arrays(DENSITY, axis, 0.01, 100.0, [matter], name="slab"), folder)


def shell(folder: Path) -> None:
    """A texel on a small skin."""
    import hagoromo as hg

    material = {"alpha": 0.2, "beta": 0.5, "gamma": 0.2, "n": 1.4, "body_colour": 0.7}
    coarse = {"voxel_mm": 0.2, "carrier_mm": 2.0, "variants": 1}
    hg.build_to({"kind": "cloth", "width_mm": 3.0, "height_mm": 3.0, "material": material, **coarse}, folder)


def array_v3(folder: Path, codec: str = "zstd", shards: bool = False) -> None:
    """An array of densities of Zarr v3, in chunks, some of them in shards."""
    import zarr
    from zarr import codecs

    known: dict[str, Any] = {
        "zstd": codecs.ZstdCodec(),
        "gzip": codecs.GzipCodec(),
        "blosc": codecs.BloscCodec(cname="lz4", typesize=4),
    }
    array: Any = zarr.create_array(
        folder, shape=DENSITY.shape, dtype="float32", chunks=(4, 4, 4), compressors=known[codec],
        shards=(8, 8, 8) if shards else None, fill_value=0,
    )  # fmt: skip
    array[:] = DENSITY


def array_v2(folder: Path, codec: str = "zlib") -> None:
    """An array of Zarr v2."""
    import numcodecs
    import zarr

    known: dict[str, Any] = {
        "zlib": numcodecs.Zlib(),
        "gzip": numcodecs.GZip(),
        "blosc": numcodecs.Blosc(),
        "lz4": numcodecs.LZ4(),
        "bz2": numcodecs.BZ2(),
    }
    filters: Any = [numcodecs.Shuffle(4)] if codec == "lz4" else None
    array: Any = zarr.create_array(
        folder, shape=DENSITY.shape, dtype="float32", chunks=(4, 4, 4), compressors=known[codec], zarr_format=2,
        filters=filters, fill_value=0,
    )  # fmt: skip
    array[:] = DENSITY
