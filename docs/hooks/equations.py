r"""Equations of the site as drawings in the page: `$…$` and `$$…$$` (LaTeX, as arithmatex marks them) → SVG.

Matplotlib's mathtext sets them, so the site needs neither a network nor a script. An equation may end in `\tag{3}`.
"""

from __future__ import annotations

import html
import re
from functools import cache
from typing import Any

from mkdocs.exceptions import PluginError

INLINE = re.compile(r'<span class="arithmatex">\\\((.*?)\\\)</span>', re.DOTALL)
DISPLAYED = re.compile(r'<div class="arithmatex">\\\[(.*?)\\\]</div>', re.DOTALL)
TAG = re.compile(r"\\tag\{(.+?)\}\s*$")
UNITS = 100.0  # of the drawing, per em
SIZE = 1.12  # em of an equation in em of the text: Stix is small beside the fonts of screens
PATH_LETTERS = {1: "M", 2: "L", 3: "Q", 4: "C", 79: "Z"}  # Matplotlib's codes of a path → SVG's
POINTS = {1: 1, 2: 1, 3: 2, 4: 3, 79: 1}


def on_page_content(page_html: str, page: Any, **_: Any) -> str:
    """Each equation of a page replaced by its drawing; one that cannot be set is an error that names page and text."""

    def drawn(latex: str, kind: str) -> str:
        text = html.unescape(latex).strip()
        tag = TAG.search(text)
        try:
            text = TAG.sub("", text).strip()
            drawing = svg(text.replace(r"\frac", r"\dfrac") if kind == "div" else text)
        except ValueError as error:
            raise PluginError(f"{page.file.src_uri}: the equation {text} cannot be set: {error}") from error
        number = f'<span class="equation-number">({tag[1]})</span>' if tag else ""
        return f'<{kind} class="equation">{drawing}{number}</{kind}>'

    page_html = DISPLAYED.sub(lambda found: drawn(found[1], "div"), page_html)
    return INLINE.sub(lambda found: drawn(found[1], "span"), page_html)


@cache
def svg(latex: str) -> str:
    """An equation as an SVG element that stands on the line of the text and has its colour."""
    import matplotlib
    from matplotlib.font_manager import FontProperties
    from matplotlib.textpath import TextToPath

    with matplotlib.rc_context({"mathtext.fontset": "stix"}):
        setter, font = TextToPath(), FontProperties(size=UNITS)
        formula = f"${' '.join(latex.split())}$"
        width, height, depth = setter.get_text_width_height_descent(formula, font, ismath=True)
        vertices, codes = setter.get_text_path(font, formula, ismath=True)
    margin = 0.04 * UNITS
    box = f"{-margin:.0f} {-(height - depth) - margin:.0f} {width + 2 * margin:.0f} {height + 2 * margin:.0f}"
    style = (
        f"width:{SIZE * (width + 2 * margin) / UNITS:.3f}em;height:{SIZE * (height + 2 * margin) / UNITS:.3f}em;"
        f"vertical-align:{-SIZE * (depth + margin) / UNITS:.3f}em"
    )
    label = html.escape(latex, quote=True)
    return (
        f'<svg role="img" aria-label="{label}" viewBox="{box}" style="{style}"><title>{label}</title>'
        f'<path fill="currentColor" d="{_outline(vertices, codes)}"/></svg>'
    )


def _outline(vertices: Any, codes: Any) -> str:
    """The path of SVG for Matplotlib's outline, y down."""
    parts, k = [], 0
    while k < len(codes):
        code = int(codes[k])
        points = " ".join(f"{x:.1f} {-y:.1f}" for x, y in vertices[k : k + POINTS[code]])
        parts.append(PATH_LETTERS[code] + ("" if code == 79 else points))
        k += POINTS[code]
    return "".join(parts)
