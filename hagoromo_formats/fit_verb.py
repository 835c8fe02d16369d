"""The command `hagoromo fit`."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote
from hagoromo.files.whole import replaceable_file

RELATIVE_ERROR = 0.01  # of a table that states no variance


@verb(verbs)
def fit(
    table: Positional[Path],
    out: Out,
    n: float | None = None,
    relative_error: float | None = None,
    facets: Literal["auto", "gaussian", "student-t"] = "auto",
    interface: Literal["auto", "neutral", "coloured"] = "auto",
    force: Force = False,
) -> None:
    """Measured BRDF (MERL's .binary, RGL's .bsdf, a CSV of directions and values) → materials.json, with intervals.

    Args:
        table: the values of a flat sample for pairs of directions.
        n: refractive index, where it is known.
        relative_error: of a value, where the table states no variance (default: 0.01).
        facets: Gaussian, with tails (student-t), or by evidence (auto).
        interface: in the colour of the lamp (neutral), coloured, or by evidence (auto).
    """
    from hagoromo.files.format import format_of, suffixes_read

    replaceable_file(out, force)
    form = format_of(table)
    if form.holds != "reflectance":
        raise hg.InputError(f"{table} is {form.name}, no table of reflectances: give {suffixes_read('reflectance')}")
    read: hg.ReflectanceTable = form.read(table)
    if read.variance is not None and relative_error is not None:
        raise hg.InputError(f"{table} states its variance: leave --relative-error out")
    if read.variance is None:
        assumed = RELATIVE_ERROR if relative_error is None else relative_error
        read = read.with_relative_error(assumed)
        say(f"{table} states no variance: a relative error of {100 * assumed:g} % is taken for every value")
    material = read.fit(table.stem, n, facets, interface)
    settings = {"n": n, "facets": facets, "interface": interface, "relative_error": relative_error}
    hg.write_materials([material], out, force, settings)
    identified = [name for name, known in material.identifiable.items() if known]
    say(f"{material.name}: {material.pixels} directions, identifiable: {', '.join(identified) or 'no parameter'}")
    say(*(f"{material.name}: {remark}" for remark in material.remarks))
    wrote(out)
