"""The record of a batch file: steps and what they are repeated for; see `read_batch`."""

from __future__ import annotations

from typing import Annotated, Any

from msgspec import Meta

from hagoromo.files.record import Count, Record, about, one_of

VERBS = (
    "simulate", "develop", "capture", "convert", "calibrate", "health", "measure", "build", "render", "expose",
    "relight", "publish",
)  # fmt: skip
Name = Annotated[str, Meta(pattern=r"^[a-z][a-z0-9_]{0,63}$")]
Patterns = str | list[str] | None


class StepRecord(Record, frozen=True, kw_only=True):
    """A step: a command with its arguments, and where its result goes."""

    name: Annotated[Name, about("name of the step; later steps write {name of the step} for its result")]
    verb: Annotated[str, one_of(*VERBS), about("command of hagoromo")]
    arguments: Annotated[
        list[str],
        about("its arguments in their order; files and folders are relative to the recipe, inside its folder"),
    ] = []
    options: Annotated[
        dict[str, Any], about("its options without --: text, number, true, or a list of them; files as in arguments")
    ] = {}
    each: Annotated[
        Patterns, about("what this step is repeated for, in place of the batch's; steps that use its result follow")
    ] = None
    out: Annotated[
        str,
        about("where the result goes, inside the folder of the batch; {name} makes those of several matches differ"),
    ]


class BatchRecord(Record, frozen=True, kw_only=True):
    """A batch: commands over many captures, scenes or recipes."""

    version_key = "format_version"

    each: Annotated[
        Patterns, about("pattern, or list of patterns, of what steps with {path} or {name} are repeated for")
    ] = None
    step: Annotated[list[StepRecord], about("the steps; one that uses the result of another stands after it")]
    format_version: Annotated[Count, about("version of the format of batch files")] = 1
