"""Command: a study as a command, with the parameters of a function as its options."""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any

import tyro

import hagoromo as hg


def command(study: Callable[..., Any]) -> None:
    """Run `study` with the options of the command line. Bad input ends in one line and exit status 2."""
    try:
        tyro.cli(study)
    except hg.InputError as error:
        print(error, file=sys.stderr)
        raise SystemExit(2) from None
