"""Lamps in turn: those that are the same code in a kernel are gone through in a loop, and the code is there once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import drjit as dr

from hagoromo.backend import Float, UInt, arrays
from hagoromo.light.lamp_light import LampInTurn, LampLight

MOST_UNROLLED = 4  # lamps of a kernel that are in it one by one

# What a lamp gives: its number, and what is known of it at a point.
OfLamp = Callable[..., list[Float]]


def in_turn(
    lights: Sequence[LampLight], known: Sequence[tuple[Any, ...]], each: OfLamp, count: int, most: int = MOST_UNROLLED
) -> list[Float]:
    """What `each` gives for every lamp, `count` numbers of a lamp after those of another.

    known: of every lamp, arrays of the same types. most: lamps up to which there is no loop.
    """
    found: list[Float] = [arrays().Float(0)] * (count * len(lights))
    for numbers in alike(lights, most):
        if len(numbers) == 1:
            given = each(numbers[0], *known[numbers[0]])
        else:
            given = _looped(numbers, lights[numbers[0]].near, known, each, count)
        for k, number in enumerate(numbers):
            found[count * number : count * (number + 1)] = given[count * k : count * (k + 1)]
    return found


def alike(lights: Sequence[LampLight], most: int) -> list[list[int]]:
    """Numbers of lamps, those together that are the same code; each alone where there are `most` or fewer."""
    if len(lights) <= most:
        return [[number] for number in range(len(lights))]
    kinds: dict[tuple[bool, bool], list[int]] = {}
    for number, light in enumerate(lights):
        kinds.setdefault((light.near, light.beam is None), []).append(number)
    return list(kinds.values())


def _looped(numbers: list[int], near: bool, known: Sequence[tuple[Any, ...]], each: OfLamp, count: int) -> list[Float]:
    """What `each` gives for lamps of some numbers, by a loop."""
    jit, first = arrays(), numbers[0]

    def one(turn: UInt, *found: Float) -> tuple[UInt | Float, ...]:
        here = [turn == k for k in range(len(numbers))]
        lamp, mine = turn + first, known[first]
        for k, number in enumerate(numbers[1:], 1):
            mine = tuple(dr.select(here[k], other, own) for other, own in zip(known[number], mine, strict=True))
            if number != first + k:
                lamp = dr.select(here[k], jit.UInt(number), lamp)
        given = each(LampInTurn(lamp, near), *mine)
        return turn + 1, *(dr.select(here[k // count], given[k % count], old) for k, old in enumerate(found))

    start = jit.UInt(0), *(jit.Float(0) for _ in range(count * len(numbers)))
    return list(dr.while_loop(start, lambda turn, *_: turn < len(numbers), one)[1:])
