"""Page: a Jinja2 template and values → one self-contained HTML file.

All values are escaped, because names of files, lamps and materials may come from untrusted sources. Only pictures and
texts that this package marks as `Markup` are inserted as HTML. Templates extend base.html.j2, which defines the layout,
and number figures and tables by the macros of parts.html.j2.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jinja2 import ChoiceLoader, Environment, PackageLoader, StrictUndefined
from markupsafe import Markup
from numpy.typing import NDArray

from hagoromo.files.whole import write_text
from hagoromo.version import __version__
from hagoromo_page.publication.document import Viewer, policy, viewer_html, viewer_style
from hagoromo_page.report.display import data_uri

TEMPLATES_PACKAGE = "hagoromo_page.report"
NUMBER_CELL = re.compile(r"[\s(]*[−+±-]?\s*[\d∞]")


def write_page(path: Path, template: str, package: str = TEMPLATES_PACKAGE, **values: Any) -> None:
    """Write the page of `template`, which lies in the folder `templates` of `package`, to `path`, whole or not."""
    write_text(path, page_text(template, package, **values))


def page_text(template: str, package: str = TEMPLATES_PACKAGE, **values: Any) -> str:
    """The HTML of `template`, in the folder `templates` of `package`, filled with `values`."""
    loaders = [PackageLoader(name) for name in dict.fromkeys((package, TEMPLATES_PACKAGE))]
    environment = Environment(
        loader=ChoiceLoader(loaders),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        extensions=["jinja2.ext.do"],
    )
    environment.filters |= {"number_columns": number_columns, "thousands": thousands}
    return environment.get_template(template).render(count=Counter(), version=__version__, **values)


def page_picture(picture: NDArray[np.uint8], alt: str, title: str = "", lossless: bool = False) -> Markup:
    """An <img> with embedded `picture` (height, width[, 3]). alt: description. title: text below it."""
    label = Markup('<span class="label">{}</span>').format(title) if title else Markup("")
    return Markup('<img alt="{}" src="{}">').format(alt, data_uri(picture, lossless)) + label


def page_viewer(viewer: Viewer | None) -> dict[str, Any]:
    """What a page needs that shows an object to relight: its HTML, and what stands in the head; nothing without one."""
    if viewer is None:
        return {"viewer": "", "viewer_head": ""}
    rules = Markup('<meta http-equiv="Content-Security-Policy" content="{}">\n').format(
        Markup(policy(viewer, "'unsafe-inline'"))
    )
    return {"viewer": viewer_html(viewer), "viewer_head": rules + viewer_style()}


def page_drawing(svg: str, alt: str) -> Markup:
    """An <svg> of one of this package's plots. alt: description for screen readers."""
    return Markup('<svg role="img" aria-label="{}"').format(alt) + Markup(svg.removeprefix("<svg"))


def number_columns(rows: Sequence[Sequence[str]]) -> list[bool]:
    """Per column of a table, whether its cells are numbers, which are then aligned on the right."""
    columns = [[str(cell) for cell in column if str(cell)] for column in zip(*rows, strict=True)]
    return [bool(column) and all(NUMBER_CELL.match(cell) or cell in "–" for cell in column) for column in columns]


def thousands(number: float) -> str:
    """A whole number with thin spaces between thousands."""
    return f"{number:,.0f}".replace(",", "\u202f")
