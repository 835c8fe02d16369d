"""Variance model: the variance of a photograph as a curve over its value, in place of a number for every pixel.

The noise of a sensor depends on the signal alone, so a few knots per channel state it: shot noise is a line, rounding
of display-encoded numbers a curve. Samples that were interpolated from a mosaic have the variance of their mean.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.sensor import BILINEAR, MOSAICS, native_of
from hagoromo.errors import InputError
from hagoromo.files.record import Record, about, decode, one_of
from hagoromo.photograph.development.master import LEAST_SHARE, Flat

HALF_STEP = 2.0**-10.5  # mean distance of two half floats, relative to their value
SHARE_CELLS = 33  # of the longer side of the picture; a flat field is smooth but for dust
FLAT_KNOTS = 17  # of a curve that has the noise of a flat field, which grows with the square of the value
LINES_TOGETHER = 256  # lines whose variance is computed at once; even, as a mosaic repeats every two lines


class VarianceRecord(Record, frozen=True, kw_only=True):
    """The variance of the stored values of a frame, as a curve over the value: linear between its knots."""

    value: Annotated[tuple[float, ...], about("knots, rising; a curve of two goes on as a line, others end flat")]
    variance: Annotated[
        tuple[tuple[float, ...], ...],
        about("of each channel the variance at the knots, in squared units of the value"),
    ]
    mosaic: Annotated[
        str, one_of(*MOSAICS), about("mosaic that the values were interpolated from, bilinear; empty: none")
    ] = ""
    share: Annotated[
        tuple[tuple[float, ...], ...],
        about("rows over the picture, bilinear, of a flat field; the curve is that of value · share"),
    ] = ()


@dataclass(frozen=True, eq=False)
class VarianceModel:
    """value: (K,) knots, rising. variance: (C, K) at them, above 0. mosaic: that values were interpolated from, or "".

    share: (rows, columns) of a flat field that values v were divided by, on a grid over the picture: their variance is
    that of the curve at v · share, over share². Raises `InputError` for knots that do not rise, or a variance that is
    not above 0.
    """

    value: NDArray[np.float64]
    variance: NDArray[np.float64]
    mosaic: str = ""
    share: NDArray[np.float32] | None = None

    def __post_init__(self) -> None:
        """Check the curve once."""
        if self.value.ndim != 1 or len(self.value) < 2 or self.variance.ndim != 2:
            raise InputError("a variance model needs two knots or more, and a variance for each channel: correct it")
        if self.variance.shape[1] != len(self.value) or not (np.diff(self.value) > 0.0).all():
            raise InputError("the knots of a variance model must rise, with one variance at each: correct it")
        if not (np.isfinite(self.variance) & (self.variance > 0.0)).all():
            raise InputError("the variances of a variance model must be finite and above 0: correct it")
        if self.share is not None and not (self.share.ndim == 2 and self.share.size and (self.share > 0.0).all()):
            raise InputError("the share of a variance model must be rows of one length, above 0: correct it")

    @staticmethod
    def from_record(record: Mapping[str, Any], where: str) -> VarianceModel:
        """The model in a frame of transforms.json."""
        stated = decode(record, VarianceRecord, f"{where}: variance_model")
        rows = {len(row) for row in stated.variance}
        if rows != {len(stated.value)}:
            raise InputError(
                f"{where}: variance_model has {len(stated.value)} knots: give each channel as many variances"
            )
        if len({len(row) for row in stated.share}) > 1:
            raise InputError(f"{where}: the share of variance_model has rows of different length: correct it")
        share = np.array(stated.share, np.float32) if stated.share else None
        return VarianceModel(np.array(stated.value), np.array(stated.variance), stated.mosaic, share)

    def record(self) -> dict[str, Any]:
        """The record of the model, the inverse of `from_record`."""
        return {
            "value": [float(f"{value:.9g}") for value in self.value],
            "variance": [[float(f"{variance:.9g}") for variance in row] for row in self.variance],
            **({"mosaic": self.mosaic} if self.mosaic else {}),
            **({} if self.share is None else {"share": [[float(f"{s:.4g}") for s in row] for row in self.share]}),
        }

    def over(self, flat: Flat) -> VarianceModel:
        """The model of values that are divided by a flat field, with the noise of that field; its share on a grid."""
        import cv2

        plane = np.where(flat.usable, flat.share, np.float32(LEAST_SHARE))
        plane = plane if plane.ndim == 2 else plane.mean(axis=2)
        scale = min(SHARE_CELLS / max(plane.shape), 1.0)
        size = max(round(plane.shape[1] * scale), 1), max(round(plane.shape[0] * scale), 1)
        share = np.asarray(cv2.resize(plane, size, interpolation=cv2.INTER_AREA), np.float32)
        relative = float(np.median(flat.variance[flat.usable] / flat.share[flat.usable]))
        value = self.value if len(self.value) > 2 else np.linspace(self.value[0], self.value[1], FLAT_KNOTS)
        rows = np.stack([np.interp(value, self.value, row) for row in self.variance])
        return VarianceModel(value, rows + relative * value**2, self.mosaic, share)

    def of(self, values: NDArray[np.float32]) -> NDArray[np.float32]:
        """Variance of `values` (height, width, C) that were stored as half floats, whose rounding is added."""
        if values.shape[2] != len(self.variance):
            raise InputError(f"a variance model of {len(self.variance)} channels for {values.shape[2]}: correct it")
        factor, result = self._shares(), np.empty(values.shape, np.float32)
        for top in range(0, len(values), LINES_TOGETHER):
            part = np.maximum(values[top : top + LINES_TOGETHER], np.float32(0.0))
            share = self._share_at(np.arange(top, top + len(part)), values.shape)
            for channel, curve in enumerate(self.variance):
                own = part[..., channel]
                spread = self._curve(own if share is None else own * share, curve)
                result[top : top + LINES_TOGETHER, :, channel] = spread if share is None else spread / share**2
            if factor is not None:
                for row, column in np.ndindex(2, 2):
                    result[top + row : top + LINES_TOGETHER : 2, column::2] *= factor[row, column]
            result[top : top + LINES_TOGETHER] += (np.float32(HALF_STEP) * part) ** 2 / np.float32(12.0)
        return result

    def native(self, height: int, width: int) -> NDArray[np.bool_] | None:
        """(height, width, 3) true where the sensor measured the channel itself; None if that is so everywhere."""
        return native_of(self.mosaic, height, width) if self.mosaic else None

    def _curve(self, values: NDArray[np.float32], curve: NDArray[np.float64]) -> NDArray[np.floating]:
        if len(self.value) > 2:
            return np.interp(values, self.value, curve)
        slope = (curve[1] - curve[0]) / (self.value[1] - self.value[0])
        return np.float32(curve[0] - slope * self.value[0]) + np.float32(slope) * values

    def _share_at(self, lines: NDArray[np.intp], shape: tuple[int, ...]) -> NDArray[np.float32] | None:
        """(lines, width) of the flat field, bilinear between the middles of its cells."""
        if self.share is None:
            return None
        row, column = (
            np.clip((at + 0.5) * cells / size - 0.5, 0.0, cells - 1.0)
            for at, cells, size in zip((lines, np.arange(shape[1])), self.share.shape, shape, strict=False)
        )
        above, below = np.floor(row).astype(int), np.ceil(row).astype(int)
        part = (row - above)[:, None]
        coarse = (1.0 - part) * self.share[above] + part * self.share[below]
        left, right = np.floor(column).astype(int), np.ceil(column).astype(int)
        across = column - left
        return ((1.0 - across) * coarse[:, left] + across * coarse[:, right]).astype(np.float32)

    def _shares(self) -> NDArray[np.float32] | None:
        """(2, 2, 3) variance of the value over that of a sample: 1 where measured, 1/n for the mean of n samples."""
        if not self.mosaic:
            return None
        native = native_of(self.mosaic, 6, 6).astype(np.float64)
        return np.stack([_spread(native[..., k], BILINEAR[colour]) for k, colour in enumerate("RGB")], axis=2)


def _spread(native: NDArray[np.float64], weights: NDArray[np.float64]) -> NDArray[np.float32]:
    """(2, 2) Σ w² over the samples of one colour around each place of the mosaic."""
    around = [native[2 + i : 4 + i, 2 + j : 4 + j] * weights[1 + i, 1 + j] ** 2 for i in (-1, 0, 1) for j in (-1, 0, 1)]
    return np.sum(around, axis=0).astype(np.float32)
