"""Table of the results of a study, for a terminal."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

TABLE_WIDTH = 140  # characters, where there is no terminal


def print_table(title: str, columns: Iterable[str], rows: Iterable[Sequence[str]]) -> None:
    """Print rows under their columns; as wide as the terminal, or TABLE_WIDTH where there is none."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    if not console.is_terminal:
        console.width = TABLE_WIDTH
    table = Table(*columns, title=title)
    for row in rows:
        table.add_row(*row)
    console.print(table)
