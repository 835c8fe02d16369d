"""Commands of a page of the documents, run as they stand there."""

import os
import re
import shlex
import subprocess
from collections.abc import Callable, Mapping
from glob import glob
from pathlib import Path

from hagoromo.app.cli import main
from studies.tutorial_views import shell_blocks


def commands(page: Path) -> list[str]:
    """Whole commands of its blocks for a shell, a here-document with the one that takes it."""
    joined = "".join(shell_blocks(page)).replace("\\\n", " ")
    return re.findall(r"^cat .*?^END$|^[^\n]+$", joined, re.DOTALL | re.MULTILINE)


def run_page(page: Path, folder: Path, instead: Mapping[str, Callable[[], object]]) -> None:
    """Run a page's commands in `folder`; each must succeed. instead: what stands for some commands, smaller."""
    before = Path.cwd()
    os.chdir(folder)
    try:
        for command in commands(page):
            if command.startswith("cat "):
                subprocess.run(["bash", "-c", command], check=True)
                continue
            name, *arguments = shlex.split(command)
            if (plain := shlex.join([name, *arguments])) in instead:
                instead[plain]()
                continue
            given = [one for word in arguments for one in (sorted(glob(word)) if "*" in word else [word])]
            assert name == "hagoromo" and main(given) == 0, command
    finally:
        os.chdir(before)
