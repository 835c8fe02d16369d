"""terms.json: the unknowns that the photographs of a measurement have in common, with their errors."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

from msgspec.structs import asdict

from hagoromo.files.checks import inside
from hagoromo.files.record import ForeignRecord, about, decode, read_json, write_json, written_by
from hagoromo.measurement.photometric.term import TermEstimate

NAME = "terms.json"


class TermsFile(ForeignRecord, frozen=True, kw_only=True):
    """terms.json."""

    terms: Annotated[dict[str, TermEstimate], about("name of each term of the model → its estimate")]


def write_terms(home: Path, estimates: Mapping[str, TermEstimate]) -> None:
    """Write the file into the folder `home`; nothing where nothing was estimated."""
    if estimates:
        each = {name: asdict(estimate) for name, estimate in estimates.items()}
        write_json(home / NAME, {"hagoromo": written_by(), "terms": each})


def read_terms(home: Path) -> dict[str, TermEstimate]:
    """What `write_terms` wrote into the folder."""
    path = inside(home, NAME)
    return decode(read_json(path), TermsFile, str(path)).terms if path.is_file() else {}
