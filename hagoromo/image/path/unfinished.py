"""Unfinished pictures: the sums of an interrupted run of mode path, kept with its picture, from which it goes on."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.finite import finite_json
from hagoromo.image.path.walk_sums import BEYOND, MOST_WALKS, SQUARE, WALKS, WANTED, WalkSums
from hagoromo.image.picture.image import Image

STOPS = ("samples", "error", "seconds")  # settings that say when to stop: others may be given when a run goes on


class RenderInterrupted(KeyboardInterrupt):
    """An interrupt of `render` by mode path. image: the picture so far, which `render` goes on from."""

    def __init__(self, image: Image) -> None:
        super().__init__(image.metadata["unfinished"])
        self.image = image


def with_sums(image: Image, sums: Sequence[WalkSums]) -> Image:
    """A picture with the sums of each batch of lamps, marked as unfinished in its metadata."""
    tables = np.zeros((len(sums), image.alpha.size, max(own.table.shape[1] for own in sums)))
    for table, own in zip(tables, sums, strict=True):
        table[:, : own.table.shape[1]] = own.table
    walks = float(np.mean([own.walks.mean() for own in sums]))
    record = image.metadata | {"walks": walks, "unfinished": f"after {walks:.4g} walks a pixel"}
    return replace(image, sums=tables.reshape(len(sums), *image.alpha.shape, -1), metadata=record)


def sums_of(image: Image, record: Mapping[str, Any], sums: Sequence[WalkSums]) -> None:
    """Fill `sums`, one for each batch of lamps, with those of an unfinished picture.

    record: the metadata of what is to be rendered. `InputError` for a picture that is finished or of something else.
    """
    if image.sums is None:
        raise InputError("the picture is not unfinished, so that there is nothing to resume: render it without resume")
    if differing := _differing(image.metadata, record):
        raise InputError(
            f"the unfinished picture is of another {differing}: resume it with that of before, or render without resume"
        )
    columns = [own.table.shape[1] for own in sums]
    if image.sums.shape != (len(sums), *image.alpha.shape, max(columns)):
        raise InputError("the unfinished picture has other weights than this scene: render without resume")
    for table, own in zip(image.sums.reshape(len(sums), image.alpha.size, -1), sums, strict=True):
        kept = table[:, : own.table.shape[1]]
        counts = kept[:, [WALKS, WANTED]]
        if not (np.isfinite(kept).all() and ((counts >= 0) & (counts <= MOST_WALKS) & (counts % 1 == 0)).all()):
            raise InputError("the sums of the unfinished picture are damaged: render without resume")
        if (kept[:, SQUARE] < 0).any() or kept.shape[1] < BEYOND:
            raise InputError("the sums of the unfinished picture are damaged: render without resume")
        own.table[:] = kept


def _differing(old: Mapping[str, Any], new: Mapping[str, Any]) -> str:
    """The first thing in which the metadata of two runs differ; "" where they agree."""
    one, other = (json.loads(finite_json(dict(record), "the metadata")) for record in (old, new))
    for record in (one, other):
        settings = record.get("settings", {})
        record["settings"] = {key: settings[key] for key in settings if key not in STOPS}
    return next((key for key in ("version", "backend", "settings", "scene") if one.get(key) != other.get(key)), "")
