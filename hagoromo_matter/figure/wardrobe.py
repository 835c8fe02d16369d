"""Wardrobe: the garments of a figure as volume boxes: their draped sheets and their cloth. Lengths in mm."""

from __future__ import annotations

from functools import lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.cache import cache
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import Extinction
from hagoromo.volume.store.plan import BoxPlan
from hagoromo.volume.texel import Texel
from hagoromo_matter.cloth.draft import plain, twill
from hagoromo_matter.cloth.fabric import woven
from hagoromo_matter.cloth.weave import Woven
from hagoromo_matter.cloth.yarn import Yarn
from hagoromo_matter.drape.eased import eased
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.drape.sheet_chart import sheet_chart
from hagoromo_matter.figure.garment import garments
from hagoromo_matter.texel.micro_structure import texel
from hagoromo_matter.texel.shell import Chart, shell

FINE_YARN = Yarn(0.30, 1.12, 2, 5.0, "S", 8.0, 40, 18.0, hairs_per_cm=6.0, hair_mm=0.35)
FULL_YARN = Yarn(0.34, 1.12, 2, 4.0, "S", 7.0, 45, 18.0, hairs_per_cm=14.0, hair_mm=0.5)
PATH = 0.035  # mean free path of light in fibres
HEM = 3.0  # voxels of the chart over which presence falls at a hem
NARROW = 3.0  # [voxels of the chart] width of the narrowest fold that the chart resolves
CHART_MARGIN = 2.0  # voxels of the chart around the cloth
COARSEST = 0.77  # least resolution of the drape: a coarser grid folds so sharply that its chart has gaps


class Garment(NamedTuple):
    """What a garment is woven of; voxels of its chart and of its texel at resolution 1, variants of the texel."""

    cloth: Woven
    chart_mm: float = 0.7
    voxel_mm: float = 0.034
    variants: int = 3


# sleeves and folds lie close: the chart is finer than their distance
WARDROBE = {
    "angel": {"robe": Garment(Woven(plain(), 20.0, 18.8, FINE_YARN, FINE_YARN, 0.5, 0.03))},
    "nun": {
        "habit": Garment(Woven(twill(2, 2), 18.0, 16.9, FULL_YARN, FULL_YARN, 0.5, 0.03)),
        "linen": Garment(Woven(plain(), 20.0, 18.8, FINE_YARN, FINE_YARN, 0.5, 0.02)),
        "veil": Garment(Woven(plain(), 20.0, 18.8, FINE_YARN, FINE_YARN, 0.5, 0.03)),
    },
}


def garment_of(
    figure: str,
    name: str,
    material: Reflectance,
    resolution: float = 1.0,
    seed: int = 1,
    extinction: Extinction = "isotropic",
) -> BoxPlan:
    """One garment of the "angel" or the "nun". material: of its fibres (cylinders). resolution: of all its lattices."""
    known = WARDROBE.get(figure, {})
    if name not in known:
        raise InputError(f"{figure} wears no {name!r}: {', '.join(known) or 'nothing'} is known")
    made = known[name]
    block = _texel(made, min(resolution, 1.0), seed)
    chart_mm = made.chart_mm / max(min(2.0 * resolution, 1.0), resolution)  # folds want it fine before yarns do
    reach = max(abs(block.bottom), abs(block.top)) * 1e3 + CHART_MARGIN * chart_mm
    period = block.period[0] * 1e3, block.period[1] * 1e3
    sheets = [eased(sheet, NARROW * chart_mm) for sheet in draped(figure, resolution, seed)[name]]
    chart, bound, extent = sheet_chart(sheets, reach, HEM * chart_mm, period, made.cloth.pitch)
    record = {"kind": "figure", "figure": figure, "part": name, "resolution": resolution, "seed": seed}
    return shell(
        lambda point: Chart(*chart(point)), bound, extent, chart_mm, block, PATH, (material,) * block.populations,
        extinction, name=f"{figure}, {name}", provenance=record,
    )  # fmt: skip


@lru_cache(maxsize=2)
def draped(figure: str, resolution: float, seed: int) -> dict[str, list[Sheet]]:
    """The draped sheets of a figure, whose garments fall together; from the cache where they fell before."""
    drape_resolution = min(max(resolution, COARSEST), 1.0)
    return cache().kept(
        ["garments", figure, drape_resolution, seed],
        _read_sheets,
        lambda: garments(figure, drape_resolution, seed),
        _write_sheets,
    )


def _write_sheets(worn: dict[str, list[Sheet]], folder: Path) -> None:
    """Into `folder`: of every garment a file of the points, coordinates and widths of its sheets."""
    for name, sheets in worn.items():
        parts = {f"{key}{k}": getattr(s, key) for k, s in enumerate(sheets) for key in ("points", "u", "v", "around")}
        np.savez(folder / f"{name}.npz", **parts)


def _read_sheets(folder: Path) -> dict[str, list[Sheet]]:
    """What `_write_sheets` wrote."""
    worn = {}
    for file in sorted(folder.glob("*.npz")):
        with np.load(file, allow_pickle=False) as parts:
            worn[file.stem] = [
                Sheet(parts[f"points{k}"], parts[f"u{k}"], parts[f"v{k}"], float(parts[f"around{k}"]))
                for k in range(len(parts.files) // 4)
            ]
    return worn


@lru_cache(maxsize=4)
def _texel(made: Garment, resolution: float, seed: int) -> Texel:
    voxel = made.voxel_mm / resolution
    fabric = woven(made.cloth, voxel, made.variants, seed)
    return texel(fabric.field, fabric.period_mm, fabric.heights_mm, voxel, fabric.populations, made.variants)
