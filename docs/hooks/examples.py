"""The pages of the examples: each script of `examples/` run when the site is built, with what it prints and draws.

A run is kept in out/examples until the script or any file of the packages changes, so no page shows what the code would
not do. A script that fails ends the build. Each page has its script, and the same as a notebook.
"""

from __future__ import annotations

import json
import subprocess
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

from example import RUN, card, examples, notebook, page, run_of
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File
from public_names import _entries

SECTION, FOLDER = "Examples", "examples"
PROCESSES = 2
HEAD = """---
hide:
  - toc
---

# Examples

Each page is a script of `examples/`, run when this site was built, with all that it printed and drew. Its end has the
script, and the same as a notebook. All data are simulated, and each takes less than a minute on one core.

"""


def on_config(config: Any, **_: Any) -> Any:
    """Fill the navigation's section of examples with their pages."""
    pages = [f"{FOLDER}/index.md", *(f"{FOLDER}/{script.stem}.md" for script in examples())]
    for entry in _entries(config.nav):
        if SECTION in entry:
            entry[SECTION] = pages
            return config
    raise PluginError(f"mkdocs.yml: the navigation has no entry {SECTION!r} for the examples")


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the page, script, notebook and pictures of each example, and the page of all."""
    cards = []
    with ThreadPoolExecutor(PROCESSES) as pool:
        homes = list(pool.map(_run, examples()))
    for script, home in zip(examples(), homes, strict=True):
        run = json.loads((home / RUN).read_text(encoding="utf-8"))
        stem = f"{FOLDER}/{script.stem}"
        files.append(File.generated(config, f"{stem}.md", content=page(script.name, run)))
        files.append(File.generated(config, f"{stem}.py", abs_src_path=str(script)))
        files.append(File.generated(config, f"{stem}.ipynb", content=json.dumps(notebook(run), ensure_ascii=False)))
        for picture in home.glob("*.png"):
            files.append(File.generated(config, f"{FOLDER}/{picture.name}", abs_src_path=str(picture)))
        cards.append(card(script.stem, run))
    grid = '<div class="cards" markdown>\n\n' + "\n".join(cards) + "\n</div>\n"
    files.append(File.generated(config, f"{FOLDER}/index.md", content=HEAD + grid))
    return files


def _run(script: Path) -> Path:
    try:
        return run_of(script)
    except subprocess.CalledProcessError as error:
        raise PluginError(f"{script.name} failed:\n{error.stderr}") from None
