"""The page of recipes: every file of examples/recipes as it is; links of other pages to these files lead to it."""

from __future__ import annotations

import re
from pathlib import Path
from posixpath import relpath
from typing import Any

from mkdocs.structure.files import File

FOLDER = Path(__file__).parents[2] / "examples" / "recipes"
PAGE = "reference/recipes.md"
LINK = re.compile(r"\]\((?:\.\./)+examples/recipes(?:/([\w-]+)\.toml)?\)")
HEAD = """# Recipes

The recipes of `examples/recipes`, as they are; they come with the package. `hagoromo build linen --out linen.zarr`
makes a volume box of one, `recipe = "linen"` puts it into a scene, and `hagoromo recipes --name linen` prints it, to
be changed. The [gallery](../gallery.md) shows them and says what each costs.
"""


def on_files(files: Any, config: Any, **_: Any) -> Any:
    """Add the page of recipes."""
    parts = [
        f"## {path.stem} {{ #{path.stem} }}\n\n```toml\n{path.read_text(encoding='utf-8').rstrip()}\n```\n"
        for path in sorted(FOLDER.glob("*.toml"))
    ]
    files.append(File.generated(config, PAGE, content="\n".join([HEAD, *parts])))
    return files


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links to a recipe's file, as they work in the repository, made links to its place on the page."""
    here = relpath(PAGE, page.file.src_uri.rpartition("/")[0] or ".")
    return LINK.sub(lambda found: f"]({here}#{found[1]})" if found[1] else f"]({here})", markdown)
