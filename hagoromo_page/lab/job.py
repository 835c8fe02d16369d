"""Job: commands that run one after the other, each a process of the command line that is shown; progress and cancel."""

from __future__ import annotations

import logging
import os
import re
import signal
import subprocess
import sys
import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from hagoromo.app.progress_bar import LIVE
from hagoromo.files.names import printable
from hagoromo_page.lab.folder import Folder, Made
from hagoromo_page.lab.step import LabStep

LOG = logging.getLogger(f"hagoromo.{__name__}")
PROGRESS = re.compile(r"^[\w ]{1,40}: (\d{1,3}) %(?:, (.*))?$")  # as hagoromo.app.progress_bar writes it
LINES, LONGEST_LINE = 60, 2000  # of what a command says, that are kept
PATIENCE_S = 30.0  # after which a command that was cancelled is ended


@dataclass
class CommandRun:
    """The steps of one press of a button, in a folder. status: None while it runs, else the last exit status."""

    folder: Callable[[], Folder]
    steps: Sequence[LabStep]
    now: int = 0
    shown: str = ""
    share: float = 0.0
    said: str = ""
    status: int | None = None
    cancelled: bool = False
    lines: deque[str] = field(default_factory=lambda: deque(maxlen=LINES))
    process: subprocess.Popen[str] | None = None
    lock: threading.Lock = field(default_factory=threading.Lock)

    def start(self) -> None:
        """Run the steps in a thread of their own."""
        threading.Thread(target=self._run, name="laboratory", daemon=True).start()

    def cancel(self) -> None:
        """End the command that runs, as Ctrl-C does: its output is whole or not there; and the others do not begin."""
        with self.lock:
            self.cancelled = True
            process = self.process
        if process is None or process.poll() is not None:
            return
        process.send_signal(signal.CTRL_BREAK_EVENT if sys.platform == "win32" else signal.SIGTERM)
        threading.Timer(PATIENCE_S, _end, (process,)).start()

    def record(self) -> dict[str, Any]:
        """What the page shows."""
        return {
            "step": self.steps[self.now].name, "number": self.now + 1, "steps": len(self.steps), "share": self.share,
            "said": self.said, "shown": self.shown, "status": self.status, "cancelled": self.cancelled,
            "lines": list(self.lines),
        }  # fmt: skip

    def _run(self) -> None:
        status = 1
        try:
            for number, step in enumerate(self.steps):
                self.now, self.share, self.said = number, 0.0, ""
                status = self._one(step)
                if status or self.cancelled:
                    break
        except Exception as error:
            LOG.error("a fault of the window, which goes on: %s", printable(error))
            self.lines.append(f"the command could not be run: {printable(error)}")
        self.status = status

    def _one(self, step: LabStep) -> int:
        """Run one command; its exit status."""
        folder = self.folder()
        words, made = step.words(folder), step.made(folder)
        self.shown = step.shown(folder)
        self.lines.append(f"$ {self.shown}")
        with self.lock:
            if self.cancelled:
                return 128 + signal.SIGTERM
            self.process = started(words, folder.home)
        with self.process as process:
            assert process.stdout is not None
            for line in process.stdout:
                self._hear(line[:LONGEST_LINE].rstrip())
        status = process.returncode
        if status == 0:
            self._keep(step, made)
        return status

    def _keep(self, step: LabStep, made: Made) -> None:
        """Keep what the result was made of; of the folder as it is now, as choices may have changed meanwhile."""
        folder = self.folder()
        folder.keep(made={**folder.record.made, step.name: made})

    def _hear(self, line: str) -> None:
        found = PROGRESS.match(line)
        if found is None:
            self.lines.append(printable(line))
        else:
            self.share, self.said = min(int(found[1]) / 100.0, 1.0), printable(found[2] or "")


def started(words: Sequence[str], folder: Path) -> subprocess.Popen[str]:
    """The command `hagoromo WORDS` in a folder, its progress in lines; what it says comes out of one pipe.

    -P: no module is imported from the folder, which is of others.
    """
    environment = {**os.environ, LIVE: "1", "PYTHONIOENCODING": "utf-8"}
    apart: dict[str, Any] = {"creationflags": 0x200} if sys.platform == "win32" else {"start_new_session": True}
    return subprocess.Popen(
        [sys.executable, "-P", "-m", "hagoromo", *words], cwd=folder, env=environment, stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, encoding="utf-8", errors="backslashreplace", **apart,
    )  # fmt: skip


def _end(process: subprocess.Popen[str]) -> None:
    if process.poll() is None:
        process.kill()
