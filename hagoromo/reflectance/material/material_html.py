"""The parameters of measured materials as rows of a table and as HTML, for notebooks and reports."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

from markupsafe import Markup, escape

from hagoromo.reflectance.parameters import FITTED_BODY_LAW, MEASURED, OF_LOBES, ROWS

if TYPE_CHECKING:
    from hagoromo.reflectance.material.material_estimate import MaterialEstimate

SYMBOLS = {each.name: each.shown for each in MEASURED if each.range is not None}
SYMBOLS |= {key: f"{SYMBOLS[key]} of the body" for key in FITTED_BODY_LAW}  # shown where they were estimated
PARAMETER_TITLES = ("material", "pixels", "parameter", "estimate", "standard error", "95 % interval", "identifiable")


def decimals(error: float | tuple[float, ...] | None) -> int:
    """Decimals that show a standard error with two significant figures; three where there is no error."""
    if not isinstance(error, float) or not 0.0 < error < math.inf:
        return 3
    return max(0, 1 - math.floor(math.log10(error)))


def parameter_rows(material: MaterialEstimate) -> list[list[str]]:
    """The cells under `PARAMETER_TITLES` for each parameter of `material`; the name stands in the first row only."""
    rows = []
    for key, symbol in SYMBOLS.items():
        error = material.standard_error.get(key)
        if key in FITTED_BODY_LAW and error is None:
            continue
        digits = decimals(error)
        low, high = (_figure(bound, digits) for bound in material.interval_95.get(key, (0.0, math.inf)))
        identifiable = "yes" if material.identifiable.get(key) else Markup('<span class="no">no</span>')
        figures = [_figure(getattr(material, key), digits), "" if error is None else f"{error:.{digits}f}"]
        first = ["", ""] if rows else [material.name, str(material.pixels)]
        rows.append([*first, symbol, *figures, f"{low} … {high}", identifiable])
    return [*rows, *_lobe_rows(material)]


def _lobe_rows(material: MaterialEstimate) -> list[list[str]]:
    """The cells of β and γ of each further lobe, which are there because the photographs show them."""
    rows = []
    errors, bounds = (getattr(material, key).get("lobes", ()) for key in ("standard_error", "interval_95"))
    for k, lobe in enumerate(material.lobes):
        for part, parameter in enumerate(ROWS[key] for key in OF_LOBES):
            error = errors[k][part] if k < len(errors) else None
            digits = decimals(error)
            low, high = bounds[k][part] if k < len(bounds) else (0.0, math.inf)
            shown = [_figure(lobe[part], digits), "" if error is None else f"{error:.{digits}f}"]
            spread = f"{_figure(low, digits)} … {_figure(high, digits)}"
            rows.append(["", "", f"{parameter.symbol} of lobe {k + 2} [{parameter.unit}]", *shown, spread, "yes"])
    return rows


def _figure(value: float, digits: int) -> str:
    return "∞" if value == math.inf else f"{value:.{digits}f}"


def materials_html(materials: Sequence[MaterialEstimate]) -> str:
    """An HTML table of the parameters of `materials`, with their remarks below it."""
    head = "".join(f"<th>{cell}</th>" for cell in PARAMETER_TITLES)
    rows = [row for material in materials for row in parameter_rows(material)]
    body = "".join("<tr>" + "".join(f"<td>{escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    remarks = [f"{escape(m.name)}: {escape(remark)}" for m in materials for remark in m.remarks]
    listed = "<ul>" + "".join(f"<li>{remark}</li>" for remark in remarks) + "</ul>" if remarks else ""
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{listed}"
