"""A contender in a process of its own: started, asked for frames one at a time, measured, ended.

The two sides talk in lines of JSON. A contender is a module with `frames(scene)`: settings, from quick to slow, and for
each a function that renders the picture (pixels, pixels) of radiance. The first frame is rendered at the start.
"""

from __future__ import annotations

import importlib
import json
import os
import re
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from peers_scene import STUDIES, PeerScene

CONTENDERS = {
    "hagoromo": "peers_hagoromo",
    "mitsuba": "peers_mitsuba",
    "numba": "peers_numba",
    "numpy": "peers_numpy",
    "vtk": "peers_vtk",
    "vtk volumetric shadows": "peers_vtk_gpu",
}
CACHES = ("NUMBA_CACHE_DIR", "XDG_CACHE_HOME", "MESA_SHADER_CACHE_DIR")  # Dr.Jit's is in HOME
TERMINAL_COLOURS = r"\x1b\[[0-9;]*m"


class AbsentError(Exception):
    """The contender cannot run here; the message says why in a few words."""


class Child:
    """The parent's side. `home` holds all caches of compiled kernels: new for a cold start, kept for a warm one.

    first: time from the start of the process to its first picture [s]. settings: names, from quick to slow.
    """

    first: float
    peak: float
    settings: list[str]

    def __init__(self, contender: str, study: int, folder: Path, home: Path) -> None:
        """Start the contender; `AbsentError` when it is not installed or stops."""
        start = time.perf_counter()
        self.picture = folder / f"{contender}.npy"
        self.log = folder / f"{contender}.log"
        settings = {"HOME": str(home)} | {cache: str(home / cache) for cache in CACHES}
        command = [sys.executable, __file__, contender, str(study), str(folder)]
        pipe: Any = subprocess.PIPE
        with self.log.open("w", encoding="utf-8") as log:
            self.process = subprocess.Popen(
                command, stdin=pipe, stdout=pipe, stderr=log, env=os.environ | settings, text=True
            )
        try:
            self.settings = self._answer()["settings"]
        except AbsentError:
            self.close()
            raise
        self.first = time.perf_counter() - start

    def frame(self, setting: str) -> float:
        """Time of one more frame [s]; afterwards `peak` is the largest memory of the process until then [MiB]."""
        assert self.process.stdin is not None
        with suppress(BrokenPipeError):  # it stopped; the missing answer tells
            print(setting, file=self.process.stdin, flush=True)
        answer = self._answer()
        self.peak = answer["peak"]
        return answer["seconds"]

    def seen(self) -> NDArray:
        """The picture of the last frame (pixels, pixels)."""
        return np.load(self.picture)

    def close(self) -> None:
        """End the process."""
        self.process.communicate()

    def _answer(self) -> dict[str, Any]:
        assert self.process.stdout is not None
        line = self.process.stdout.readline()
        if not line:
            text = self.log.read_text(encoding="utf-8", errors="replace")
            said = [line for line in text.split("\n") if line] or ["no word why"]
            raise AbsentError(f"stopped: {re.sub(TERMINAL_COLOURS, '', said[-1])}")
        answer = json.loads(line)
        if "absent" in answer:
            raise AbsentError(answer["absent"])
        return answer


def serve(contender: str, study: int, folder: Path) -> None:
    """The child's side: render the first frame, then one for every line read."""
    speak = os.fdopen(os.dup(1), "w", buffering=1, encoding="utf-8")
    os.dup2(2, 1)  # what the contender prints must not come between
    try:
        frames = importlib.import_module(CONTENDERS[contender]).frames(PeerScene(STUDIES[study], folder))
    except ModuleNotFoundError as error:
        print(json.dumps({"absent": f"not installed: {error.name}"}), file=speak)
        return
    next(iter(frames.values()))()
    print(json.dumps({"settings": list(frames)}), file=speak)
    for line in sys.stdin:
        start = time.perf_counter()
        picture = frames[line.rstrip("\n")]()
        seconds = time.perf_counter() - start
        np.save(folder / f"{contender}.npy", picture)
        print(json.dumps({"seconds": seconds, "peak": peak_memory()}), file=speak)


def peak_memory() -> float:
    """Largest resident memory of this process so far [MiB].

    Linux tells it apart; elsewhere it is getrusage's, which may begin with that of the parent.
    """
    status = Path("/proc/self/status")
    if status.exists():
        lines = status.read_text(encoding="utf-8").split("\n")
        return next(int(line.split()[1]) for line in lines if line.startswith("VmHWM")) / 1024
    import resource

    unit = 1024**2 if sys.platform == "darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / unit


if __name__ == "__main__":
    serve(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
