"""Page: the parts of a self-contained HTML page: headings, paragraphs, tables, numbered figures."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import NDArray

from hagoromo.app.display import data_uri

STYLE = """
:root { color-scheme: light; }
body { background: #fcfcfa; color: #1c1c1c; margin: 0 auto; max-width: 62rem; padding: 2.5rem 1.5rem 5rem;
       font: 17px/1.58 Georgia, 'Times New Roman', serif; }
h1 { font-size: 2rem; line-height: 1.2; margin: 0 0 .3rem; }
h2 { font-size: 1.35rem; margin: 2.8rem 0 .6rem; border-bottom: 1px solid #ddd; padding-bottom: .25rem; }
p, ul { max-width: 46rem; }
.lead { color: #555; margin-top: 0; }
figure { margin: 1.4rem 0; }
figcaption { font-size: .86rem; line-height: 1.45; color: #444; max-width: 46rem; margin-top: .45rem; }
figcaption b { color: #1c1c1c; }
img, svg { max-width: 100%; height: auto; display: block; }
.row { display: flex; gap: .5rem; align-items: flex-start; }
.row > div { min-width: 0; }
.grid { display: grid; grid-template-columns: 1fr 1fr; gap: .5rem .6rem; }
.label { display: block; font-size: .78rem; line-height: 1.3; color: #555; margin: .15rem 0 .35rem; }
table { border-collapse: collapse; font-size: .86rem; margin: 1rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .75rem .2rem 0; text-align: left; vertical-align: top; }
th { border-bottom: 1.5px solid #999; font-weight: 600; }
td { border-bottom: 1px solid #eee; }
tr.first td { border-top: 1px solid #bbb; }
.no { color: #b00020; font-weight: 600; }
code { font-size: .85em; background: #f1f1ec; padding: 0 .25em; border-radius: 3px; }
@media print { body { font-size: 11pt; } figure, table { break-inside: avoid; } }
"""


class Page:
    """An HTML page in the making; text given to it is HTML, figures and tables are numbered."""

    def __init__(self, title: str, lead: str) -> None:
        self.title = title
        self.parts = [f"<h1>{escape(title)}</h1>", f'<p class="lead">{lead}</p>']
        self.figures = self.tables = 0

    def section(self, heading: str, *paragraphs: str) -> None:
        """A heading and its paragraphs."""
        self.parts += [f"<h2>{escape(heading)}</h2>", *(f"<p>{paragraph}</p>" for paragraph in paragraphs)]

    def text(self, *paragraphs: str) -> None:
        """Further paragraphs."""
        self.parts += [f"<p>{paragraph}</p>" for paragraph in paragraphs]

    def bullets(self, points: Sequence[str]) -> None:
        """A list."""
        self.parts.append("<ul>" + "".join(f"<li>{point}</li>" for point in points) + "</ul>")

    def figure(self, caption: str, *bodies: str) -> None:
        """Images or SVG side by side under one numbered caption."""
        self._figure(caption, "row", bodies)

    def grid(self, caption: str, *bodies: str) -> None:
        """Images in two columns under one numbered caption."""
        self._figure(caption, "grid", bodies)

    def stack(self, caption: str, *bodies: str) -> None:
        """Images one above the other under one numbered caption."""
        self._figure(caption, "stack", bodies)

    def table(self, caption: str, head: Sequence[str], body: Sequence[Sequence[str]], group: int = 0) -> None:
        """A numbered table; cells are HTML; a line is drawn before every `group` rows."""
        self.tables += 1
        rows = []
        for k, cells in enumerate(body):
            first = ' class="first"' if group and k % group == 0 else ""
            rows.append(f"<tr{first}>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
        top = "".join(f"<th>{cell}</th>" for cell in head)
        self.parts.append(
            f"<figure><table><thead><tr>{top}</tr></thead><tbody>{''.join(rows)}</tbody></table>"
            f"<figcaption><b>Table {self.tables}.</b> {caption}</figcaption></figure>"
        )

    def html(self) -> str:
        """The page."""
        head = f'<meta charset="utf-8"><title>{escape(self.title)}</title><style>{STYLE}</style>'
        viewport = '<meta name="viewport" content="width=device-width, initial-scale=1">'
        body = "\n".join(self.parts)
        return f'<!doctype html>\n<html lang="en"><head>{head}{viewport}</head>\n<body>\n{body}\n</body></html>\n'

    def _figure(self, caption: str, kind: str, bodies: Sequence[str]) -> None:
        self.figures += 1
        inner = "".join(f"<div>{body}</div>" for body in bodies)
        self.parts.append(
            f'<figure><div class="{kind}">{inner}</div>'
            f"<figcaption><b>Figure {self.figures}.</b> {caption}</figcaption></figure>"
        )


def image(picture: NDArray[np.uint8], title: str = "", lossless: bool = False) -> str:
    """An <img> that carries its picture; the title, if any, stands under it."""
    label = f'<span class="label">{escape(title)}</span>' if title else ""
    return f'<img alt="{escape(title)}" src="{data_uri(picture, lossless)}">{label}'
