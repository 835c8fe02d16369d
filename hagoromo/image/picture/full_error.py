"""Full error: how far a picture of mode full is off, as walks through some of its pixels say: see `image.full.judge`.

What is stated holds for Y of all light, over its mean where there is matter, but for the error of few bands.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields
from typing import Any

BLOCK = 8  # px a side
KEY = "full_error"  # of metadata
WAYS = "solved", "mended"


@dataclass(frozen=True)
class Off:
    """How far a picture is off, over its true mean where there is matter: the estimate and its 95 % interval of each.

    mean: of all pixels. blocks: of blocks of 8 × 8 pixels, root mean square. worst: of the block that is farthest off.
    """

    mean: float
    mean_interval: tuple[float, float]
    blocks: float
    blocks_interval: tuple[float, float]
    worst: float
    worst_interval: tuple[float, float]

    @property
    def at_most(self) -> float:
        """What neither the mean nor the blocks are farther off than, but in some 5 of 100 pictures."""
        return max(*map(abs, self.mean_interval), self.blocks_interval[1])


@dataclass(frozen=True)
class FullError:
    """What `walks` say of a picture of mode full: as it was solved, and as it is, mended by them.

    worst_at: row and column of the first pixel of the block that is farthest off as solved, and of that which is known
    worst as it is.
    """

    walks: int
    solved: Off
    mended: Off
    worst_at: tuple[tuple[int, int], tuple[int, int]]

    def record(self) -> dict[str, Any]:
        """As plain values."""
        return asdict(self)

    @classmethod
    def of(cls, metadata: Mapping[str, Any]) -> FullError | None:
        """From the metadata of an image; None where they have none, or what is none."""
        try:
            found = metadata[KEY]
            solved, mended = (Off(*(_as_numbers(found[way][each.name]) for each in fields(Off))) for way in WAYS)
            first, second = ((int(row), int(column)) for row, column in found["worst_at"])
            return cls(int(found["walks"]), solved, mended, (first, second))
        except (KeyError, TypeError, ValueError, AttributeError):
            return None

    def line(self) -> str:
        """One line for people."""
        mended, solved = _words(self.mended), _words(self.solved)
        return f"mode full: {mended}, by {self.walks:,} walks (95 %); without their mend: {solved}"


def _as_numbers(value: Any) -> Any:
    """A number of a record, or two, as floats."""
    if isinstance(value, Sequence):
        low, high = map(float, value)
        return low, high
    return float(value)


def _words(off: Off) -> str:
    middle, half = (100.0 * number for number in (off.mean, 0.5 * (off.mean_interval[1] - off.mean_interval[0])))
    low, high = (100.0 * number for number in off.blocks_interval)
    return (
        f"mean {middle:+.1f} ± {half:.1f} %, blocks of {BLOCK} × {BLOCK} pixels {100.0 * off.blocks:.1f} % "
        f"({low:.1f} to {high:.1f}) off, the worst about {100.0 * abs(off.worst):.0f} %"
    )
