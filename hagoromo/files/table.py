"""CSV tables of numbers: a header row of column names, then one row of numbers each."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.finite import check_finite
from hagoromo.files.whole import write_text

MOST_COLUMNS = 4096
LARGEST_TABLE = 1 << 26  # bytes
GROWTH = 30.0  # memory of the cells of a file as texts, in its sizes
LARGEST = 1e100  # of a cell: sums and squares of larger ones are no numbers


def read_table(path: str | Path) -> dict[str, NDArray[np.float64]]:
    """Column name → (rows,) float64, in the file's order; empty lines and lines that start with # are skipped.

    `InputError` if the file is missing, is not text, has no header or no rows, rows of different lengths, or a cell
    that is not a finite number up to `LARGEST`.
    """
    return read_table_and_comment(path)[0]


def read_table_and_comment(path: str | Path) -> tuple[dict[str, NDArray[np.float64]], str]:
    """As `read_table`, and the first line of the file where it starts with #, else an empty text."""
    try:
        text = read_bytes(sized_file(path, LARGEST_TABLE, "a CSV table"), GROWTH).decode("utf-8-sig")
        rows = [
            (number, row)
            for number, row in enumerate(csv.reader(text.splitlines()), 1)
            if any(cell.strip() for cell in row) and not row[0].startswith("#")
        ]
    except (UnicodeDecodeError, csv.Error) as error:
        raise InputError(f"{path} is not CSV text: {error}") from error
    if len(rows) < 2:
        raise InputError(f"{path} has {len(rows)} rows: a table needs a header row and at least one row of numbers")
    names = [cell.strip() for cell in rows[0][1]]
    if all(_number(name) is not None for name in names):
        raise InputError(f"{path} has no header row: name its columns in the first row, such as wavelength_nm,value")
    if len(names) > MOST_COLUMNS:
        raise InputError(f"{path} has {len(names)} columns, a table {MOST_COLUMNS} at most: give another")
    if len(set(names)) != len(names) or "" in names:
        raise InputError(f"{path} has columns {', '.join(names)}: give each its own name")
    values = np.empty((len(rows) - 1, len(names)))
    for index, (line, row) in enumerate(rows[1:]):
        values[index] = _numbers(row, names, f"{path} line {line}")
    first = text.split("\n", 1)[0]
    return {name: values[:, column].copy() for column, name in enumerate(names)}, first if first[0:1] == "#" else ""


def write_table(path: str | Path, columns: Mapping[str, ArrayLike], comment: str = "") -> None:
    """Write `columns`, name → (rows,), such that `read_table` returns the same float64 numbers.

    comment: a line before the columns, which `read_table` skips. `InputError` for numbers that are not finite.
    """
    arrays = [np.asarray(values, dtype=np.float64) for values in columns.values()]
    if len({array.shape for array in arrays}) != 1 or arrays[0].ndim != 1:
        raise InputError(f"a table needs columns of one length: given shapes {[array.shape for array in arrays]}")
    check_finite(
        {f"column {name}": array for name, array in zip(columns, arrays, strict=True)}, Path(path).name, "rows"
    )
    text = io.StringIO(newline="")
    text.write(f"# {comment}\n" if comment else "")
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(columns)
    writer.writerows([repr(float(value)) for value in row] for row in zip(*arrays, strict=True))
    write_text(path, text.getvalue())


def _numbers(row: list[str], names: list[str], where: str) -> list[float]:
    if len(row) != len(names):
        raise InputError(f"{where} has {len(row)} cells and the header has {len(names)}: it may be cut off")
    numbers = []
    for cell, name in zip(row, names, strict=True):
        value = _number(cell)
        if value is None or not abs(value) <= LARGEST:
            raise InputError(f"{where}, column {name}: {cell!r} is not a finite number up to {LARGEST:g}")
        numbers.append(value)
    return numbers


def _number(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def is_number(word: str) -> bool:
    """Whether Python reads the word as a number."""
    try:
        float(word)
    except ValueError:
        return False
    return True
