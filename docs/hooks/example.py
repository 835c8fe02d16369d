"""An example of `examples/`: its cells, its run, its page, its notebook. `python example.py SCRIPT FOLDER` runs it.

A line `# %%` begins a cell; the comment that follows it is its text, in Markdown, and the rest its code. The docstring
of the script is the title and the text of the page. Every `plt.show()` is a picture. FOLDER gets the pictures and
run.json.
"""

from __future__ import annotations

import ast
import contextlib
import hashlib
import io
import itertools
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from functools import cache
from importlib.metadata import version
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).parents[2]
EXAMPLES, KEPT = ROOT / "examples", ROOT / "out" / "examples"
RUN = "run.json"
PACKAGES = ("drjit", "mitsuba", "numpy", "scipy", "matplotlib", "colour-science")  # whose versions a run depends on
READ = (".py", ".toml", ".csv", ".json", ".npz")  # suffixes of what a run may read of this repository
DPI = 120
LINK = re.compile(r"\[([^\]]+)\]\((?!https?:)[^)]+\)")  # to another page


class Cell(NamedTuple):
    """A part of a script: text in Markdown, code, and the number of lines before the code."""

    text: str
    code: str
    above: int


def cells_of(script: str) -> tuple[str, str, list[Cell]]:
    """Title, text and cells of a script."""
    first = ast.parse(script).body[0]
    said = ast.get_docstring(ast.parse(script)) or ""
    title, _, about = said.partition("\n")
    lines, cells = script.splitlines(), []
    starts = [number for number, line in enumerate(lines) if line.startswith("# %%")]
    edges = [first.end_lineno or 0, *starts, len(lines)]
    for begin, end in itertools.pairwise(edges):
        above = begin + 1 if begin in starts else begin
        text = []
        while begin in starts and above < end and lines[above].startswith("#"):
            text.append(lines[above].removeprefix("#").removeprefix(" "))
            above += 1
        code = "\n".join(lines[above:end])
        above += len(code) - len(code.lstrip("\n"))
        if text or code.strip():
            cells.append(Cell("\n".join(text).strip(), code.strip("\n"), above))
    return title.strip(), about.strip(), cells


def examples() -> list[Path]:
    """The scripts, in their order."""
    return sorted(EXAMPLES.glob("[0-9]*.py"))


def run_of(script: Path) -> Path:
    """The folder of a run of the script as it is, by the packages as they are; it is run where there is none.

    `subprocess.CalledProcessError` with what it said, where it fails.
    """
    key = hashlib.sha256(script.read_bytes() + source_digest().encode()).hexdigest()[:16]
    home = KEPT / f"{script.stem}-{key}"
    if (home / RUN).is_file():
        return home
    KEPT.mkdir(parents=True, exist_ok=True)
    made = Path(tempfile.mkdtemp(dir=KEPT, prefix=".running-"))
    try:
        command = [sys.executable, "-W", "error", str(Path(__file__)), str(script), str(made)]
        one_core = {"HAGOROMO_THREADS": "1", "OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
        set_up = {**os.environ, **one_core, "MPLBACKEND": "agg", "PYTHONPATH": str(ROOT)}
        subprocess.run(command, cwd=made, env=set_up, check=True, capture_output=True, text=True, encoding="utf-8")
        for old in set(KEPT.glob(f"{script.stem}-*")) - {home}:
            shutil.rmtree(old, ignore_errors=True)
        with contextlib.suppress(OSError):  # another process has made it meanwhile
            os.replace(made, home)
    finally:
        shutil.rmtree(made, ignore_errors=True)
    return home


@cache
def source_digest() -> str:
    """Digest of what every run depends on: the packages' files and the versions of others."""
    found = hashlib.sha256(Path(__file__).read_bytes())
    files = [*ROOT.glob("hagoromo*/**/*"), *EXAMPLES.glob("recipes/*")]
    for file in sorted(one for one in files if one.suffix in READ):
        found.update(f"{file.relative_to(ROOT)}\0".encode() + file.read_bytes())
    found.update("".join(f"{name} {version(name)}\n" for name in PACKAGES).encode())
    return found.hexdigest()


def page(name: str, run: dict[str, Any]) -> str:
    """The Markdown of an example."""
    parts = ["---\nhide:\n  - toc\n---", f"# {run['title']}", run["about"]]
    for cell in run["cells"]:
        parts += [cell["text"]] if cell["text"] else []
        parts += [f"```python\n{cell['code']}\n```"] if cell["code"] else []
        parts += [f'```text title="Output"\n{cell["output"].rstrip()}\n```'] if cell["output"].strip() else []
        parts += [f"![{one['alt']}]({one['file']})" for one in cell["pictures"]]
    took = f"It took {run['cpu_s']:.0f} s of processor time on one core when this page was built."
    stem = name.removesuffix(".py")
    return "\n\n".join([*parts, f"---\n\n[Script: {name}]({name}) · [Notebook: {stem}.ipynb]({stem}.ipynb) · {took}\n"])


def card(stem: str, run: dict[str, Any]) -> str:
    """An example on the page of all: its first picture, title and text."""
    pictures = [one for cell in run["cells"] for one in cell["pictures"]]
    image = f"![{pictures[0]['alt']}]({pictures[0]['file']})" if pictures else ""
    first = run["about"].split("\n\n")[0]
    return f"<div markdown>\n\n[{image}]({stem}.md)\n\n**[{run['title']}]({stem}.md)**\n\n{first}\n\n</div>\n"


def notebook(run: dict[str, Any]) -> dict[str, Any]:
    """The example as a Jupyter notebook (nbformat 4.5), with what it printed; links into the site are plain text."""
    texts = [f"# {run['title']}\n\n{run['about']}"]
    cells: list[dict[str, Any]] = []
    for number, cell in enumerate(run["cells"]):
        texts += [cell["text"]] if cell["text"] else []
        for text in texts:
            plain = LINK.sub(r"\1", text)
            cells.append({"cell_type": "markdown", "id": f"text-{len(cells)}", "metadata": {}, "source": plain})
        texts = []
        said = [{"output_type": "stream", "name": "stdout", "text": cell["output"]}] if cell["output"] else []
        cells.append(
            {
                "cell_type": "code", "id": f"code-{len(cells)}", "metadata": {}, "execution_count": number + 1,
                "source": cell["code"], "outputs": said,
            }
        )  # fmt: skip
    kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
    return {"cells": cells, "metadata": {"kernelspec": kernel}, "nbformat": 4, "nbformat_minor": 5}


def main(script: Path, folder: Path) -> None:
    """Run the script, with the folder as its working directory."""
    import matplotlib.pyplot as plt

    title, about, cells = cells_of(script.read_text(encoding="utf-8"))
    pictures: list[dict[str, str]] = []
    count = itertools.count(1)

    def show(*_: Any, **__: Any) -> None:
        for number in plt.get_fignums():
            figure = plt.figure(number)
            name = f"{script.stem}_{next(count)}.png"
            figure.savefig(folder / name, dpi=DPI, bbox_inches="tight")
            pictures.append({"file": name, "alt": _alt(figure)})
        plt.close("all")

    plt.show = show
    space: dict[str, Any] = {"__name__": "__main__", "__file__": str(script)}
    begun, done = time.process_time(), []
    for cell in cells:
        printed = io.StringIO()
        pictures.clear()
        with contextlib.redirect_stdout(printed):
            exec(compile("\n" * cell.above + cell.code, str(script), "exec"), space)  # noqa: S102 - our own script
            show()
        done.append({"text": cell.text, "code": cell.code, "output": printed.getvalue(), "pictures": list(pictures)})
    run = {"title": title, "about": about, "cells": done, "cpu_s": time.process_time() - begun}
    for left in folder.iterdir():  # what the script wrote
        if not re.fullmatch(rf"{re.escape(script.stem)}_\d+\.png", left.name):
            shutil.rmtree(left) if left.is_dir() else left.unlink()
    (folder / RUN).write_text(json.dumps(run, ensure_ascii=False, indent=1), encoding="utf-8")


def _alt(figure: Any) -> str:
    """What a figure shows, by its titles and axes."""
    axes = [one for one in figure.axes if one.get_title() or (one.get_xlabel() and one.get_ylabel())]
    words = [figure.get_suptitle(), *(one.get_title() or f"{one.get_ylabel()} over {one.get_xlabel()}" for one in axes)]
    return " · ".join(dict.fromkeys(filter(None, words))).replace("\n", " ")


if __name__ == "__main__":
    main(Path(sys.argv[1]).resolve(), Path(sys.argv[2]).resolve())
