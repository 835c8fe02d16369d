"""What pages name must exist: files, make targets, studies, verbs and options of commands; else no site is built."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path
from typing import Any

from commands import help_of, verbs
from mkdocs.exceptions import PluginError

from studies.table_of_studies import STUDIES

ROOT = Path(__file__).parents[2]
GENERATED = tuple(
    f"reference/{name}" for name in ("api", "commands.md", "recipes.md", "fields.md")
)  # made from what there is
CODE = re.compile(r"(?<!`)`([^`\n]+)`(?!`)")
PATH = re.compile(r"(?:hagoromo(?:_\w+)?|studies|tests|benchmarks|examples|docs)/[\w/.-]*|[a-z]\w*\.py")
BLOCK = re.compile(r"^```sh\n(.*?)^```", re.MULTILINE | re.DOTALL)
COMMAND = re.compile(r"(?<!import )\bhagoromo ((?:calibrate )?[a-z]+)((?: [^\n|;#]*)?)")
TARGET = re.compile(r"^make ([a-z-]+)")
STUDY = re.compile(r"^python -m studies ([a-z-]+)")


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """The page as it is, or an error that names what it names and there is not."""
    where = page.file.src_uri
    if where.startswith(GENERATED):
        return markdown
    texts = [*CODE.findall(markdown), *"\n".join(BLOCK.findall(markdown)).replace("\\\n", " ").splitlines()]
    for text in (text.split(" #")[0].strip() for text in texts):
        if PATH.fullmatch(text) and not _exists(text):
            raise PluginError(f"{where} names {text}, and the repository has no such file")
        target = TARGET.match(text)
        if target and target[1] not in _targets():
            raise PluginError(f"{where} names make {target[1]}, and the Makefile has no such target")
        study = STUDY.match(text)
        if study and study[1] not in STUDIES:
            raise PluginError(f"{where} names the study {study[1]}, and there is no such study")
        for verb, arguments in COMMAND.findall(text):
            _check_command(where, tuple(verb.split()), re.findall(r"(?<!\S)--([a-z][a-z-]*)", arguments))
    return markdown


def _check_command(where: str, verb: tuple[str, ...], options: list[str]) -> None:
    if verb not in verbs():
        raise PluginError(f"{where} names hagoromo {' '.join(verb)}, and there is no such command")
    unknown = [option for option in options if f"--{option}" not in help_of(*verb) and option != "help"]
    if unknown:
        raise PluginError(f"{where}: hagoromo {' '.join(verb)} has no option --{', --'.join(unknown)}")


@cache
def _exists(path: str) -> bool:
    """Whether a file or folder is there; a name alone may lie anywhere in the package."""
    return (
        (ROOT / path).exists()
        if "/" in path
        else any(found for package in ROOT.glob("hagoromo*") for found in package.rglob(path))
    )


@cache
def _targets() -> set[str]:
    return set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE))
