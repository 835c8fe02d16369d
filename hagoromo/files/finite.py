"""What is written is finite: no picture, box, table or record leaves with NaN or infinity in it."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING, Any

from hagoromo.errors import InputError

if TYPE_CHECKING:
    from numpy.typing import NDArray  # loaded where it is needed: the command line writes JSON without it

BLOCK = 1 << 22  # values that are looked at together


def check_finite(quantities: Mapping[str, NDArray], where: str, what: str = "pixels") -> None:
    """Raise `InputError`, which names the first of `quantities` that is not finite and counts its `what`.

    quantities: name → array of any shape. where: the file.
    """
    for name, values in quantities.items():
        if values.dtype.kind == "f" and (count := _not_finite(values)):
            raise InputError(
                f"{where} cannot be written: {name} is not finite in {count} of {values.size} {what}: look for numbers "
                "that are too large, such as the intensity of a lamp or an exposure"
            )


def finite_json(record: Any, where: str, **layout: Any) -> str:
    """`record` as JSON text; `InputError` for NaN or infinity, which JSON has not, or what it cannot represent.

    layout: further arguments of `json.dumps`.
    """
    try:
        return json.dumps(record, allow_nan=False, ensure_ascii=False, **layout)
    except (ValueError, TypeError) as error:
        for key, value in _numbers(record, ""):
            if not math.isfinite(value):
                raise InputError(f"{where} cannot be written: {key} is {value}: give finite numbers") from error
        raise InputError(f"{where} cannot be written: {error}") from error


def _not_finite(values: NDArray) -> int:
    """Number of values that are not finite."""
    import numpy as np

    flat = values.reshape(-1) if values.flags.c_contiguous else np.ravel(values)
    blocks = (flat[start : start + BLOCK] for start in range(0, flat.size, BLOCK))
    return sum(block.size - int(np.count_nonzero(np.isfinite(block))) for block in blocks)


def _numbers(record: Any, key: str) -> Iterator[tuple[str, float]]:
    """All floats of plain values with their keys."""
    if isinstance(record, float):
        yield key, record
    elif isinstance(record, Mapping):
        for name, value in record.items():
            yield from _numbers(value, f"{key}.{name}" if key else str(name))
    elif isinstance(record, (list, tuple)):
        for index, value in enumerate(record):
            yield from _numbers(value, f"{key}[{index}]")
