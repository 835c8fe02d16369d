"""The page of commands, written from the commands themselves: what `hagoromo VERB --help` prints, verb by verb."""

from __future__ import annotations

import contextlib
import io
import os
import re
from functools import cache
from typing import Any

from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File

PAGE = "reference/commands.md"
ANSI = re.compile(r"\x1b\[[0-9;]*m")
RULE = re.compile(r"[-─]{5,}")
ENTRY = re.compile(r"^ {2,4}(?! )(.+?)(?: {2,}(.*))?$")  # an argument, and what it means if that stands beside it
UNSAID = re.compile(r" ?\(default: (?:None|False|)\)|\{None\}\|")
HEAD = """# Commands

This page is written from the commands themselves when the site is built; `hagoromo VERB --help` prints the same in a
terminal. Exit status: 0 done; 2 wrong use or bad input, with one line that says what is wrong, what was given and what
to do; 130 interrupted; 1 a bug. A result is written whole or not at all.

Every command takes these, too:

| argument | meaning |
|---|---|
| `--allow FOLDER` | scenes, recipes and captures elsewhere may name files of this folder, also by `HAGOROMO_ALLOW` |
| `--verbose` | what is done meanwhile, on standard error; in Python it is `logging`, under the name `hagoromo` |
| `--quiet` | errors and results alone: no warnings, no progress, no names of written files |

`HAGOROMO_BACKEND` (cuda, metal, llvm) chooses what kernels run on. [Completion of a shell](../machines.md#completion).
"""


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the page of commands to the site."""
    files.append(File.generated(config, PAGE, content=page()))
    return files


def page() -> str:
    """Markdown with a section per verb."""
    return "\n".join([HEAD, *(section(verb) for verb in verbs() if "subcommands" not in help_of(*verb))])


def section(verb: tuple[str, ...]) -> str:
    """What a verb does, how it is called, and a table of its arguments."""
    usage, *lines = help_of(*verb).splitlines()
    starts = [k for k, line in enumerate(lines) if RULE.search(line) and line.strip("╭─╮╰╯│ -") == ""] or [len(lines)]
    about = "\n".join(lines[: starts[0] - 1]).strip()
    rows: list[list[str]] = []
    for line in (line.strip("│").rstrip() for line in lines[starts[0] - 1 :]):
        found = ENTRY.match(line)
        if found and "show this help" not in line:
            rows.append([found[1], found[2] or ""])
        elif line.startswith("     ") and rows:
            rows[-1][1] += " " + line.strip()
    if not about or not rows:
        raise PluginError(f"docs/hooks/commands.py cannot read the help of {' '.join(verb)!r}: has its layout changed?")
    table = ["| argument | meaning |", "|---|---|", *(f"| `{_cell(name)}` | {_cell(text)} |" for name, text in rows)]
    title = f"## hagoromo {' '.join(verb)} {{ #{'-'.join(verb)} }}"
    call = usage.removeprefix("usage: ").replace("[-h] ", "")
    return "\n\n".join([title, about, f"```text\n{UNSAID.sub('', call)}\n```", "\n".join(table), ""])


def _cell(text: str) -> str:
    return UNSAID.sub("", text).replace("|", "\\|").strip()


def verbs(*group: str) -> list[tuple[str, ...]]:
    """Every verb, and every verb of a group, in the order of `hagoromo --help`."""
    from hagoromo.app.cli import abouts  # with all commands registered

    names = sorted(abouts)
    if group:
        shown = help_of(*group)
        usage = re.match(r"usage: hagoromo[^{]*\{([^}]*)\}", shown)
        names = re.sub(r"\s", "", usage[1]).split(",") if usage and "subcommands" in shown else []
    return [verb for name in names for verb in ((*group, name), *verbs(*group, name))]


@cache
def help_of(*verb: str) -> str:
    """What `hagoromo VERB --help` prints, without colours, in lines that are not broken."""
    from hagoromo.app.cli import main

    said, columns = io.StringIO(), os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "1000"
    try:
        with contextlib.redirect_stdout(said), contextlib.suppress(SystemExit):
            main([*verb, "--help"])
    finally:
        os.environ.pop("COLUMNS") if columns is None else os.environ.update(COLUMNS=columns)
    return ANSI.sub("", said.getvalue()).rstrip()
