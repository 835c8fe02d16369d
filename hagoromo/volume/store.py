"""Volume boxes on disk: a Zarr v3 group that any Zarr reader opens.

Arrays `density` (nz, ny, nx), `axis` (nz, ny, nx, 3) and, where the box has them, `material` (nz, ny, nx) and
`body_colour` (nz, ny, nx, j). Chunks are blocks of 8³ bricks; chunks without matter are absent. Attributes:
`hagoromo` with format version, voxel size [m], pose, τ, materials, basis and provenance.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.files.door import check_memory
from hagoromo.files.record import anything, count, list_of, numbers, positive, table, take, text
from hagoromo.files.whole import whole_folder
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import reflectance_from_record
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.bricks import BRICK, STORED, VOXELS, Bricks, check_shape, occupied_bricks, table_of

FORMAT = 1
CHUNK = 8 * BRICK  # voxels a side
AXES = ("z", "y", "x")


def save_box(box: VolumeBox, path: str | Path, force: bool = False) -> None:
    """Write `box` as a Zarr group at `path`, whole or not at all."""
    import zarr

    grids = _grids(box)
    with whole_folder(path, force) as folder:
        group = zarr.open_group(folder, mode="w", zarr_format=3)
        group.attrs["hagoromo"] = _record(box)
        for name, (width, kind, _) in grids.items():
            shape, chunks = box.bricks.shape, tuple(min(CHUNK, n) for n in box.bricks.shape)
            more = (width,) if width else ()
            group.create_array(
                name, shape=shape + more, chunks=chunks + more, dtype=kind, fill_value=0,
                dimension_names=AXES + (("component",) if width else ()), config={"write_empty_chunks": False},
            )  # fmt: skip
        for corner, block in _blocks(box, grids):
            region = tuple(slice(c, min(c + CHUNK, n)) for c, n in zip(corner, box.bricks.shape, strict=True))
            for name, values in block.items():
                array: Any = group[name]
                array[region] = values[tuple(slice(0, r.stop - r.start) for r in region)]


def load_box(path: str | Path) -> VolumeBox:
    """The volume box in the Zarr group at `path`; `InputError` when it is missing, damaged, foreign or too large."""
    folder = Path(path)
    if not (folder / "zarr.json").is_file():
        raise InputError(f"{folder} is no volume box: give a Zarr v3 group that `hagoromo build` wrote")
    try:
        return _load(folder)
    except InputError:
        raise
    except (OSError, ValueError, KeyError, TypeError, RuntimeError, json.JSONDecodeError) as error:
        raise InputError(f"{folder} cannot be read as a volume box: {' '.join(str(error).split())[:200]}") from error


def _load(folder: Path) -> VolumeBox:
    import zarr

    group = zarr.open_group(folder, mode="r", zarr_format=3)
    record = _checked_record(group.attrs.asdict().get("hagoromo"), str(folder))
    density: Any = group["density"]
    axis: Any = group["axis"]
    check_shape(density.shape)
    if axis.shape != (*density.shape, 3):
        raise InputError(f"{folder}: axis is {axis.shape}, density {density.shape} needs {(*density.shape, 3)}")
    check_memory(20.0 * np.prod(density.shape, dtype=np.float64) / max(density.shape[0] / CHUNK, 1), f"{folder}")
    optional = {name: group[name] for name in ("body_colour", "material") if name in group}
    bricks = _bricks({"density": density, "axis": axis, **optional}, str(folder))
    kept = {key: record[key] for key in ("voxel_size", "tau", "name", "provenance")}
    materials = [reflectance_from_record(m, f"{folder}: material {k}") for k, m in enumerate(record["materials"])]
    basis = tuple(Spectrum.load(s) for s in record["basis"])
    pose = np.reshape(record["pose"], (4, 4))
    return VolumeBox(bricks, materials=tuple(materials), basis=basis, pose=pose, **kept)


def _record(box: VolumeBox) -> dict[str, Any]:
    return {
        "format": FORMAT, "voxel_size": box.voxel_size, "tau": box.tau, "name": box.name,
        "pose": box.pose.ravel().tolist(), "materials": [m.record() for m in box.materials],
        "basis": [s.record() for s in box.basis], "provenance": box.provenance,
    }  # fmt: skip


def _checked_record(record: Any, where: str) -> dict[str, Any]:
    if record is None:
        raise InputError(f"{where} is a Zarr group without the attribute 'hagoromo': it is no volume box")
    spec = {
        "format": count, "voxel_size": positive, "tau": positive, "name": (text, ""), "pose": numbers(16),
        "materials": list_of(anything), "basis": (list_of(anything), []), "provenance": (table, {}),
    }  # fmt: skip
    taken = take(record, spec, where)
    if taken["format"] != FORMAT:
        raise InputError(f"{where} has format {taken['format']}: this version reads {FORMAT}, update Hagoromo")
    return taken


def _grids(box: VolumeBox) -> dict[str, tuple[int, str, np.ndarray]]:
    """Per array of the group: components, type, and its values per kept brick (bricks, 9, 9, 9, …)."""
    stored = (-1, STORED, STORED, STORED)
    voxels = np.array(box.bricks.voxels).reshape(*stored, 4)
    grids = {"density": (0, "float16", voxels[..., 0]), "axis": (3, "float16", voxels[..., 1:])}
    if box.bricks.colour is not None:
        width = max(len(box.basis), 1)
        colour = np.array(box.bricks.colour).reshape(*stored, 4)[..., :width]
        grids["body_colour"] = (width, "float16", colour)
    if box.bricks.material is not None:
        grids["material"] = (0, "uint16", np.array(box.bricks.material).reshape(stored).astype(np.uint16))
    return grids


def _blocks(box: VolumeBox, grids: dict[str, tuple[int, str, np.ndarray]]) -> Any:
    """Corner and dense values of every block of 8³ bricks that holds matter.

    A voxel on the face of a kept brick may lie in an empty one (whose own interpolation cells hold no matter): blocks
    are filled from the shared layers too.
    """
    table = box.bricks.table
    across = [-(-n // CHUNK) for n in box.bricks.shape]
    for corner in np.ndindex(*across):
        low = np.array(corner) * BRICK
        window = tuple(slice(max(c - 1, 0), c + BRICK) for c in low)
        near = np.argwhere(table[window] >= 0) + [w.start for w in window]
        if not len(near):
            continue
        block = {
            name: np.zeros((CHUNK + 2 * BRICK,) * 3 + ((width,) if width else ()), kind)
            for name, (width, kind, _) in grids.items()
        }
        for place in near:
            z, y, x = (place - low + 1) * BRICK
            brick = table[tuple(place)]
            for name, (_, _, values) in grids.items():
                block[name][z : z + STORED, y : y + STORED, x : x + STORED] = values[brick]
        inner = slice(BRICK, BRICK + CHUNK)
        yield low * BRICK, {name: values[inner, inner, inner] for name, values in block.items()}


def _bricks(grids: dict[str, Any], where: str) -> Bricks:
    """Bricks of the arrays of a group, read in slabs of one chunk of layers."""
    shape = grids["density"].shape
    kinds, keep, parts = arrays(), [], {name: [] for name in grids}
    for z in range(0, max(shape[0] - 1, 1), CHUNK):
        slab = {"density": np.asarray(grids["density"][z : z + CHUNK + 1])}
        density = slab["density"].astype(np.float32)
        if not np.isfinite(density).all() or density.min() < 0:
            raise InputError(f"{where}: density has values that are NaN, infinite or below 0")
        keep.append(occupied_bricks(density > 0))
        if not keep[-1].any():
            continue
        slab |= {name: np.asarray(grid[z : z + CHUNK + 1]) for name, grid in grids.items() if name != "density"}
        if not np.isfinite(slab["axis"]).all():
            raise InputError(f"{where}: axis has values that are not finite")
        places = np.argwhere(keep[-1]) * BRICK
        steps = np.arange(STORED)
        index = [
            np.minimum(places[:, k, None] + steps, density.shape[k] - 1).reshape(-1, *np.roll((STORED, 1, 1), k))
            for k in range(3)
        ]
        for name, values in slab.items():
            parts[name].append(values[tuple(index)])
    whole = {name: np.concatenate(p) if p else None for name, p in parts.items()}
    return Bricks(shape, table_of(np.concatenate(keep)), *_on_device(whole, kinds))


def _on_device(values: dict[str, np.ndarray | None], kinds: Any) -> tuple[Any, Any, Any]:
    density, axis = values["density"], values["axis"]
    if density is None or axis is None:
        return kinds.Float16(np.zeros(VOXELS * 4, np.float16)), None, None
    voxels = np.concatenate([density[..., None], axis], axis=-1).astype(np.float16)
    colour, material = values.get("body_colour"), values.get("material")
    if colour is not None:
        colour = np.concatenate([colour, np.zeros((*colour.shape[:-1], 4 - colour.shape[-1]))], axis=-1)
    return (
        kinds.Float16(voxels.ravel()),
        None if colour is None else kinds.Float16(colour.astype(np.float16).ravel()),
        None if material is None else kinds.UInt(material.astype(np.uint32).ravel()),
    )
