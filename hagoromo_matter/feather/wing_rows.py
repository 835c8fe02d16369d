"""Wing rows: the feathers of a wing, row by row, each with its own small random turn, length, bend and lift. All in mm.

Rows overlap as on a bird: seen from beneath (the front), the inner vane of a feather covers the outer vane of the next
one inwards; coverts lie on both faces, every row over the one behind it.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo_matter.feather.wing_bones import WRIST, arm

# along the arm: share of its length; turn of feathers from straight down outwards [°]; length of the longest
AT = (0.0, 0.076, 0.178, 0.302, 0.433, 0.562, 0.679, 0.772, 0.868, 1.0)
ROW_TURN = (4.0, 3.0, 3.0, 3.5, 4.5, 6.5, 9.0, 12.0, 15.0, 17.0)
ROW_LENGTHS = (46.0, 58.0, 76.0, 99.0, 125.0, 151.0, 172.0, 190.0, 198.0, 192.0)
BOW = (0.0, 0.0, 1.0, 2.0, 4.0, 7.0, 13.0, 24.0, 38.0, 46.0)  # of the tips inwards
ARM_HALF_THICKNESS = (2.8, 2.8, 2.7, 2.5, 2.3, 2.1, 1.7, 1.3, 0.9, 0.7)  # half thickness of the arm
TILED = 0.085  # slope of a feather across: each lies on its neighbour


class FeatherRow(NamedTuple):
    """A row of feathers: how many; first and last place on the arm (shares of its length); root: how far behind the
    leading edge they are rooted; reach: to which share of the longest feather they reach; widths as multiples of their
    distance; level: number of the row above the sheet, above 0 in front, below 0 behind, 0 for the
    flight feathers; wild: how much they vary.
    """

    count: int
    first: float
    last: float
    root: float
    reach: float
    outer: float
    inner: float
    level: int
    wild: float


FLIGHT = (
    FeatherRow(5, 0.02, 0.17, 5.0, 0.97, 1.0, 1.3, 0, 1.2),  # tertials
    FeatherRow(14, 0.2, 0.655, 7.0, 0.96, 0.95, 1.45, 0, 1.0),  # secondaries
    FeatherRow(10, 0.69, 1.0, 6.0, 1.0, 0.75, 1.4, 0, 0.8),  # primaries
)
COVERTS = (
    FeatherRow(21, 0.03, 0.66, 6.0, 0.47, 0.85, 1.1, 1, 1.3),  # greater secondary coverts
    FeatherRow(11, 0.69, 0.99, 5.0, 0.4, 0.9, 1.3, 1, 1.2),  # primary coverts
    FeatherRow(34, 0.02, 0.98, 3.0, 0.3, 0.95, 1.1, 2, 1.6),  # median
    FeatherRow(40, 0.01, 0.985, 1.5, 0.215, 1.0, 1.1, 3, 1.9),  # lesser, four rows
    FeatherRow(46, 0.0, 0.99, 1.2, 0.165, 1.0, 1.15, 4, 2.1),
    FeatherRow(52, 0.0, 0.99, 0.8, 0.122, 1.05, 1.2, 5, 2.3),
    FeatherRow(58, 0.0, 0.995, 0.5, 0.085, 1.1, 1.25, 6, 2.5),
    FeatherRow(64, 0.0, 0.995, 0.2, 0.053, 1.15, 1.3, 7, 2.7),  # marginal
)
ALULA = FeatherRow(4, 0.67, 0.73, 0.5, 0.22, 1.1, 1.5, 5, 1.0)
SCAPULARS = FeatherRow(8, 0.0, 0.13, 0.5, 0.5, 1.8, 2.2, 5, 3.0)
FEATHER_FIELDS = (
    "x", "z", "sine", "cosine", "bow", "length_mm", "outer_mm", "inner_mm", "rachis_mm", "quill", "tip", "root",
    "end", "curl", "tilt", "hollow", "face", "seed", "flight",
)  # fmt: skip


def feathers(seed: int) -> NDArray[np.float32]:
    """The feathers of both wings, (2, n, len(FEATHER_FIELDS)): right and left differ only in their random part.

    x, z: of the root; sine, cosine: of the turn outwards; bow: curvature inwards [1/mm]; root, end: height at the root
    and at the tip; curl: how far the tip bends forwards; tilt: slope across; hollow: how far the edges hang back; face:
    1 where the upper side of the feather looks forwards, −1 elsewhere; flight: 1 for flight feathers, 0 for coverts.
    """
    draw = np.random.default_rng(seed)
    rows = [*FLIGHT, *COVERTS, *(_behind(row) for row in (*COVERTS, ALULA, SCAPULARS))]
    return np.stack([np.concatenate([_row(row, draw) for row in rows]) for _ in range(2)]).astype(np.float32)


def height_of(across: Any, share: Any, feather: Any) -> Any:
    """Height of the middle of a feather over the sheet; share: of its length; feather: by name, see `feathers`."""
    landed = share * (1.0 / 0.55)
    landed = landed - (landed - 1.0) * (landed > 1.0)
    settled = landed * landed * (3.0 - 2.0 * landed)
    wide = across / (0.5 * (feather["outer_mm"] + feather["inner_mm"]))
    rise = feather["root"] + (feather["end"] - feather["root"]) * settled
    return rise + feather["tilt"] * across + feather["curl"] * share * share * share - feather["hollow"] * wide * wide


def _behind(row: FeatherRow) -> FeatherRow:
    """The row on the upper face of the wing."""
    return row._replace(level=-row.level)


def _row(row: FeatherRow, draw: np.random.Generator) -> NDArray[np.float64]:
    """The feathers of one row, (n, len(FEATHER_FIELDS))."""
    n, face, rank = row.count, np.sign(row.level), abs(row.level)
    pitch = (row.last - row.first) / max(n - 1, 1)
    place = np.linspace(row.first, row.last, n) + 0.12 * row.wild * pitch * draw.uniform(-1, 1, n)
    if rank:  # neighbouring rows do not stand in line
        place = place + 0.5 * pitch * (rank % 2)
    place = np.clip(place, 0.0, 1.0)
    point, direction = arm(place)
    turn = np.radians(np.interp(place, AT, ROW_TURN) + row.wild * 1.3 * draw.uniform(-1, 1, n))
    longest = np.interp(place, AT, ROW_LENGTHS)
    reach = row.reach * longest * (1.0 + 0.03 * row.wild * draw.uniform(-1, 1, n))
    length = np.maximum(reach - row.root, 6.0)
    step = pitch * np.linalg.norm(arm(np.array([0.5 + 1e-3]))[0] - arm(np.array([0.5 - 1e-3]))[0]) / 2e-3
    step = step * np.maximum(np.abs(direction[:, 0] * np.cos(turn) + direction[:, 1] * np.sin(turn)), 0.72)
    spread = 1.0 + (0.35 if row.first >= WRIST else 0.1) * row.reach  # feathers fan out
    thick, along = np.interp(place, AT, ARM_HALF_THICKNESS), np.stack([np.sin(turn), -np.cos(turn)], axis=1)
    start = point + along * row.root
    flight = rank == 0
    bow = 2.0 * np.interp(place, AT, BOW) / longest**2 * (1.0 + 0.15 * row.wild * draw.uniform(-1, 1, n))
    lift = 0.16 * row.wild * draw.uniform(-1, 1, n)
    over = np.minimum(max(row.root, 0.0), thick)  # of the arm's round edge, under the root
    edge = np.sqrt(np.maximum(thick**2 - (thick - over) ** 2, 0.0))
    outwards = face or 1.0
    field = {
        "x": start[:, 0], "z": start[:, 1], "sine": np.sin(turn), "cosine": np.cos(turn),
        "bow": np.maximum(bow, 1e-4),
        "length_mm": length,
        "outer_mm": row.outer * step * spread, "inner_mm": row.inner * step * spread,
        "rachis_mm": 1.4 if flight else 0.04 + 0.006 * length, "quill": 0.06 if flight else 0.02,
        "tip": (0.3 if flight else min(0.45 + 0.05 * rank, 0.75)) + 0.05 * draw.uniform(-1, 1, n),
        "root": face * (0.9 * edge + 0.08 * rank) + 0.5 * lift,
        "end": face * (1.0 + 0.5 * rank) * (0.5 + 0.17 * thick) + lift,
        "curl": outwards * (1.8 if flight else 0.5) * draw.uniform(0.2, 1, n),
        "tilt": TILED * (1.0 + 0.15 * draw.uniform(-1, 1, n)), "hollow": -0.9 if flight else 0.6 * face,
        "face": 1.0 if face > 0 else -1.0, "seed": draw.integers(0, 1 << 22, n), "flight": float(flight),
    }  # fmt: skip
    return np.stack([field[name] * np.ones(n) for name in FEATHER_FIELDS], axis=1)
