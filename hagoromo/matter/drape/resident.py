"""Resident: numbers of NumPy in memory of Dr.Jit's own, which may be freed at any time, also while it records."""

from __future__ import annotations

from typing import Any

import drjit as dr

from hagoromo.backend import arrays, lookup


def resident(kind: Any, values: Any) -> Any:
    """A flat Dr.Jit array of `kind`, a copy of `values`.

    An array that shares NumPy's memory must not be freed while `dr.freeze` records: the process would abort.
    """
    shared = lookup(kind, values)
    copy = dr.gather(kind, shared, dr.arange(arrays().UInt, dr.width(shared)))
    dr.eval(copy)
    dr.sync_thread()
    return copy
