"""The command `hagoromo`: where it is, and how it is run."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path

import bpy

NOT_OURS = ("PYTHONHOME", "PYTHONPATH", "PYTHONSTARTUP")  # of Blender's own Python
SHARE = re.compile(r"(\d+) %")  # of a line of progress
MISSING = "the command hagoromo was not found: install it (pip install hagoromo) and give its path in the preferences"


class Refused(RuntimeError):
    """What the command said as it refused or failed: one line for the user."""


class Preferences(bpy.types.AddonPreferences):
    """Where the command is."""

    bl_idname = __package__ or "hagoromo"
    command: bpy.props.StringProperty(  # pyrefly: ignore
        name="Command", description="Path of the command hagoromo; empty: it is searched for", subtype="FILE_PATH"
    )

    def draw(self, _context: bpy.types.Context) -> None:
        """The one field."""
        self.layout.prop(self, "command")


def program() -> str:
    """Path of the command: of the preferences, of HAGOROMO_COMMAND, or found where commands are; `Refused`."""
    addon = bpy.context.preferences.addons.get(Preferences.bl_idname)
    stated = addon.preferences.command if addon and addon.preferences else ""
    found = stated or os.environ.get("HAGOROMO_COMMAND") or shutil.which("hagoromo")
    if not found:
        raise Refused(MISSING)
    return bpy.path.abspath(found)


def run(*arguments: str | Path, progress: Callable[[float], bool] | None = None) -> str:
    """Run the command, and give what it printed. progress: takes a share of the work, and says whether to go on.

    `Refused` with its last line where it ends with an error, or was stopped.
    """
    environment = {name: value for name, value in os.environ.items() if name not in NOT_OURS}
    environment["HAGOROMO_LIVE"] = "1"
    words = [program(), *map(str, arguments)]
    lines = ["it said nothing"]
    try:
        job = subprocess.Popen(
            words, env=environment, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, encoding="utf-8"
        )
    except OSError as error:
        raise Refused(f"{words[0]} cannot be run: {error.strerror}") from error
    with job:
        assert job.stderr is not None and job.stdout is not None
        for line in job.stderr:
            lines.append(line.strip() or lines[-1])
            share = SHARE.search(line)
            if progress and share and not progress(int(share[1]) / 100):
                job.terminate()
                raise Refused("stopped")
        printed = job.stdout.read()
    if job.returncode:
        raise Refused(lines[-1].removeprefix("hagoromo: "))
    return printed


def register() -> None:
    """The preferences."""
    bpy.utils.register_class(Preferences)


def unregister() -> None:
    """The same back."""
    bpy.utils.unregister_class(Preferences)
