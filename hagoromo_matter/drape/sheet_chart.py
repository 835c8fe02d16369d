"""Sheet chart: coordinates u, v, height and frame of a point over the nearest of several sheets. Lengths in mm."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, column
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.texel.shell import Chart

CHART_SPACING_MM = 0.5  # [mm] between the points of a sheet that are searched
FOOT_ITERATIONS = 3  # iterations for the foot of a point; each reduces the error by height × curvature
POINTS_AT_ONCE = 1 << 17  # points that are looked up together, few enough for the cache
SHEET_OFFSET = 1000.0  # periods, or mm, between the u and v of one sheet and those of the next
CUT, FADED = 0.5, 0.2  # presence below which a sheet has no matter, and a voxel farther out, to which its cut is smooth
TOUCHING = 1 / 3  # [edges] distance of another sheet up to which its matter, not the smooth cut, has the voxel
FAR_MM = 8.0  # mm beyond the reach, up to which distances are computed

Extent = tuple[tuple[float, ...], tuple[float, ...]]


def sheet_chart(
    sheets: Sequence[Sheet],
    reach_mm: float,
    edge_mm: float = 0.8,
    period_mm: tuple[float, float] | None = None,
    pitch_mm: tuple[float, float] | None = None,
) -> tuple[Callable[[Any], Chart], Callable[[Any], Any], Extent]:
    """Chart of the nearest of `sheets`, bound of the distance to them, and corners of all within `reach_mm` of them.

    Presence falls to 0 at the hems over edge_mm, and is 0 beyond reach_mm. A hem makes no hole in the cloth beneath:
    where the nearest sheet is cut, the nearest that is not is charted, close to that from presence ½ on, elsewhere
    from a voxel farther out. Bounds are at most reach_mm + FAR_MM.
    period_mm: of what repeats along u and v: the widths of tubes are taken for the nearest whole number of periods.
    pitch_mm: of yarns along u and v, gaps between which are at its multiples: hems lie in the nearest gaps, so that no
    yarn along a hem is cut.
    """
    if not (sheets and 0 < reach_mm < np.inf and 0 < edge_mm < np.inf):
        raise InputError(f"{len(sheets)} sheets, reach_mm {reach_mm:g}, edge_mm {edge_mm:g}: give all above 0")
    dense = _Samples(sheets, period_mm or (0.0, 0.0), pitch_mm or (0.0, 0.0), 0.5 * edge_mm)

    def chart(point: Any) -> Chart:
        asked = np.array(point, np.float32).T
        parts = [
            dense.place(part, reach_mm, edge_mm) for part in np.array_split(asked, len(asked) // POINTS_AT_ONCE + 1)
        ]
        values = np.ascontiguousarray(np.concatenate(parts).T, np.float32)
        height, u, v, presence, *frame = (column(arrays().Float, row) for row in values)
        normal, along = arrays().Array3f(*frame[:3]), arrays().Array3f(*frame[3:])
        return Chart(height, normal, u, v, along, presence)

    def bound(point: Any) -> Any:
        return (
            column(arrays().Float, dense.distance(np.array(point, np.float64).T, reach_mm + FAR_MM).astype(np.float32))
            - reach_mm
        )

    low, high = dense.points.min(axis=0) - reach_mm, dense.points.max(axis=0) + reach_mm
    return chart, bound, (tuple(low.tolist()), tuple(high.tolist()))


class _Samples:
    """Dense points of sheets with their tangents, by number."""

    def __init__(
        self, sheets: Sequence[Sheet], period: tuple[float, float], pitch: tuple[float, float], half_edge: float
    ) -> None:
        from scipy.spatial import KDTree

        require(300.0 * sum(sheet.u.size * _times(sheet) ** 2 for sheet in sheets), "the points of the sheets")
        fine = [sheet.refined(_times(sheet)) for sheet in sheets]
        tables, shape = [], []
        first = 0
        for number, (sheet, coarse) in enumerate(zip(fine, sheets, strict=True)):
            rows, columns = sheet.u.shape
            u, around = _snapped(sheet, period[0])
            aside = number * SHEET_OFFSET * (period[0] or 1.0)
            tables.append(_table(sheet, u, around))
            sides = (-np.inf, np.inf) if sheet.around else _in_gaps(u, pitch[0], half_edge)
            hems = _in_gaps(coarse.v, pitch[1], half_edge) + sides
            shape.append((first, rows, columns, bool(sheet.around), *hems, aside))
            first += len(tables[-1])
        self.values = np.concatenate(tables).astype(np.float32)
        self.points = self.values[:, :3]
        self.shape = np.array(shape, np.float32)
        self.sheet = np.repeat(np.arange(len(fine)), [len(table) for table in tables])
        self.coarsest = max(sheet.spacing for sheet in fine)
        self.tree = KDTree(self.points)
        ends = np.searchsorted(self.sheet, np.arange(1, len(fine)))
        parts = zip(np.split(self.points, ends), (0, *ends.tolist()), strict=True)
        self.each = [(KDTree(part), start) for part, start in parts] if len(fine) > 1 else []

    def distance(self, asked: NDArray[np.floating], reach: float) -> NDArray[np.floating]:
        """A lower bound of the distance to the sheets, at most `reach`."""
        far = self.tree.query(asked, distance_upper_bound=reach, workers=-1)[0]
        return np.minimum(far, reach) - self.coarsest

    def place(self, asked: NDArray[np.floating], reach: float, edge: float) -> NDArray[np.floating]:
        """height, u, v, presence, normal and direction of u for points (n, 3): (n, 10)."""
        far, nearest = self.tree.query(asked, distance_upper_bound=reach + self.coarsest, workers=-1)
        nearest, is_within_reach = np.asarray(nearest), np.isfinite(far)
        out = np.zeros((len(asked), 10), np.float32)
        out[:, 0], out[:, 6], out[:, 7] = reach, 1.0, 1.0
        if is_within_reach.any():
            out[is_within_reach] = self._foot(asked[is_within_reach], nearest[is_within_reach], edge)
            past = np.flatnonzero(is_within_reach & (out[:, 3] < CUT))
            self._beneath(out, asked, past, nearest, reach, edge)
        return out

    def _beneath(
        self,
        out: NDArray[np.floating],
        asked: NDArray[np.floating],
        past: NDArray[np.intp],
        nearest: NDArray[np.int64],
        reach: float,
        edge: float,
    ) -> None:
        """Rows `past` of `out`, beyond the hem of the nearest sheet, on the nearest other one that is present there."""
        far = np.full(len(past), np.inf)
        for number, (tree, start) in enumerate(self.each):
            other = np.flatnonzero(self.sheet[nearest[past]] != number)
            away, found = tree.query(asked[past[other]], distance_upper_bound=reach + self.coarsest, workers=-1)
            nearer = np.flatnonzero(np.isfinite(away) & (away < far[other]))
            if len(nearer):
                rows = past[other[nearer]]
                there = self._foot(asked[rows], start + np.asarray(found)[nearer], edge)
                cut = out[rows, 3] < np.where(away[nearer] < TOUCHING * edge, CUT, FADED)
                better = cut & (there[:, 3] > CUT)
                out[rows[better]] = there[better]
                far[other[nearer[better]]] = away[nearer[better]]

    def _foot(self, asked: NDArray[np.floating], nearest: NDArray[np.int64], edge: float) -> NDArray[np.floating]:
        shape: list[NDArray[np.floating]] = list(self.shape[self.sheet[nearest]].T)
        first, rows, columns, closed, lowest, highest, left, right, aside = shape
        wide = columns + closed  # columns of the table
        row: NDArray[np.floating] = (nearest - first) // wide
        column: NDArray[np.floating] = (nearest - first) % wide
        for turn in range(FOOT_ITERATIONS + 1):
            value = self._at(first, wide, rows, row, column)
            offset, across, down = asked - value[:, :3], value[:, 3:6], value[:, 6:9]
            if turn < FOOT_ITERATIONS:
                more_column, more_row = _solved(across, down, offset)
                row = np.clip(row + np.clip(more_row, -2, 2), 0.0, rows - 1)
                column = column + np.clip(more_column, -2, 2)
                column = np.where(closed > 0, column % columns, np.clip(column, 0.0, columns - 1))
        normal = _unit(np.cross(across, down))
        along, beside = _unit(across), _unit(down)
        height = _dot(offset, normal)
        u, v = value[:, 9] + _dot(offset, along), value[:, 10] + _dot(offset, beside)
        inside = np.minimum(np.minimum(v - lowest, highest - v), np.minimum(u - left, right - u))
        presence = np.clip(inside / edge, 0.0, 1.0)
        frame = _unit(along + np.cross(beside, normal))  # halfway, where the cloth is sheared
        return np.column_stack([height, u + aside, v + aside, presence, normal, frame]).astype(np.float32)

    def _at(self, first: Any, wide: Any, rows: Any, row: NDArray, column: NDArray) -> NDArray[np.floating]:
        """The table between its entries (bilinear): (n, 11)."""
        i, j = np.minimum(np.floor(row), rows - 2), np.minimum(np.floor(column), wide - 2)
        y, x = (row - i)[:, None], (column - j)[:, None]
        at = (first + i * wide + j).astype(np.int64)
        step = wide.astype(np.int64)
        low = self.values[at] * (1.0 - x) + self.values[at + 1] * x
        high = self.values[at + step] * (1.0 - x) + self.values[at + step + 1] * x
        return low * (1.0 - y) + high * y


def _table(sheet: Sheet, u: NDArray, around: float) -> NDArray[np.floating]:
    """Place, its derivatives by column and by row, u and v of all points, the first column of a tube twice: (n, 11)."""
    points = sheet.points
    if sheet.around:
        points = np.concatenate([points[:, -1:], points, points[:, :2]], axis=1)
        across = np.gradient(points, axis=1)[:, 1:-1]
        points = points[:, 1:-1]
        u = np.concatenate([u, u[:, :1] + around], axis=1)
        v = np.concatenate([sheet.v, sheet.v[:, :1]], axis=1)
    else:
        across, v = np.gradient(points, axis=1, edge_order=2), sheet.v
    down = np.gradient(points, axis=0, edge_order=2)
    return np.concatenate([points, across, down, u[..., None], v[..., None]], axis=2).reshape(-1, 11)


def _snapped(sheet: Sheet, period: float) -> tuple[NDArray[np.floating], float]:
    """u and width of a sheet, a tube's made a whole number of periods."""
    if not (sheet.around and period):
        return sheet.u, sheet.around
    around = max(round(sheet.around / period), 1) * period
    return sheet.u * (around / sheet.around), around


def _in_gaps(along: NDArray, pitch: float, half_edge: float) -> tuple[float, float]:
    """Ends of a sheet along u or v, moved so that presence ½, `half_edge` within, lies in the nearest gap of yarns."""
    low, high = float(along.min()), float(along.max())
    if not pitch:
        return low, high
    gaps = round((low + half_edge) / pitch) * pitch, round((high - half_edge) / pitch) * pitch
    return gaps[0] - half_edge, gaps[1] + half_edge


def _times(sheet: Sheet) -> int:
    return max(1, round(sheet.spacing / CHART_SPACING_MM))


def _solved(across: NDArray, down: NDArray, offset: NDArray) -> tuple[NDArray, NDArray]:
    """Shares a, b with a · across + b · down the foot of `offset` on their plane."""
    aa, bb, ab = _dot(across, across), _dot(down, down), _dot(across, down)
    a, b = _dot(across, offset), _dot(down, offset)
    scale = 1.0 / np.maximum(aa * bb - ab * ab, 1e-12)  # 0 where the cloth is degenerate
    return (bb * a - ab * b) * scale, (aa * b - ab * a) * scale


def _dot(one: NDArray, other: NDArray) -> NDArray[np.floating]:
    return np.einsum("ij,ij->i", one, other)


def _unit(vector: NDArray) -> NDArray[np.floating]:
    return vector / np.maximum(np.linalg.norm(vector, axis=1, keepdims=True), 1e-12)
