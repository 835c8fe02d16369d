"""Apart: a C library that prints what it finds wrong with a file, or may crash on it, decodes in a process of its own.

Its standard error is closed there, and nowhere else: notebooks and other threads print meanwhile. A process takes a
quarter of a second to start.
"""

from __future__ import annotations

import io
import json
import logging
import os
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError

Arrays = dict[str, NDArray[Any]]
ERROR = "error"  # name of the array that holds the message of an `InputError`
START = "import json, sys; sys.path[:] = json.loads(sys.argv[1]); from hagoromo.files.apart import serve; serve()"


def read_apart(read: Callable[[Path], Mapping[str, NDArray[Any]]], path: Path, what: str) -> Arrays:
    """The arrays that `read`, a function of a module, gives of `path`; it runs in another process.

    what: what the file is read as, for the message of the `InputError` when that process dies.
    """
    logging.getLogger(__name__).debug("reading %s as %s in a process of its own", path, what)
    place = [json.dumps(sys.path), read.__module__, read.__qualname__, str(path)]
    done = subprocess.run(
        [sys.executable, "-c", START, *place],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
    )
    try:
        with np.load(io.BytesIO(done.stdout), allow_pickle=False) as stored:
            arrays = {name: stored[name] for name in stored.files}
    except Exception as error:
        raise InputError(
            f"{path} cannot be read as {what}: the library that reads it has crashed: copy it again"
        ) from error
    if ERROR in arrays:
        raise InputError(str(arrays[ERROR]))
    return arrays


def serve() -> None:
    """The other process: its arguments name the function and the file; it writes the arrays to standard output."""
    _, _, module, name, path = sys.argv
    out = os.fdopen(os.dup(1), "wb")
    nowhere = os.open(os.devnull, os.O_WRONLY)
    for stream in (1, 2):
        os.dup2(nowhere, stream)
    try:
        arrays = dict(getattr(__import__(module, fromlist=["_"]), name)(Path(path)))
    except InputError as error:
        arrays = {ERROR: np.array(str(error))}
    with out:
        np.savez(out, allow_pickle=False, **arrays)  # type: ignore[arg-type]
