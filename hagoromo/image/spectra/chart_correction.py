"""What a chart shows to be wrong with its photograph, and the correction of that and of other photographs like it.

Values that are clipped or coded by the sRGB curve, that follow light to another power or are off in the dark, and light
that falls off over the chart: each is found by `read_response` under the one lamp of the photograph.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.response.calibrate_response import read_response
from hagoromo.calibration.response.chart_falloff import light_over_chart
from hagoromo.calibration.response.doubtful_readings import NEAR_TOP
from hagoromo.calibration.response.response_calibration import ResponseCalibration
from hagoromo.light.colour import srgb_decode
from hagoromo.light.spectrum import Spectrum

EDGE_X, EDGE_Y = 1.2, 4.0 / 3.0  # of the chart, where the middles of its outer patches are at ±1
FARTHEST = 3.0  # in the same units: beyond, the light is taken to be as there
LARGEST_STEP = 1.5  # of ln light, from its mean over the chart
SRGB = (
    "the values are coded by the sRGB curve, not linear in light: decoded here; develop the photograph without a curve"
)
Array = NDArray[Any]


@dataclass(frozen=True, eq=False)
class ChartCorrection:
    """calibration: of the photograph of the chart alone, under its lamp; its readings are those after `full`. full: the
    value of white, where the values are coded by the sRGB curve; 0 where they are not. ceilings: (channels,) values
    from which a channel is clipped; inf where it is not. corners: (4, 2) of the chart [px].
    """

    calibration: ResponseCalibration
    full: float
    ceilings: Array
    corners: Array

    @property
    def falloff(self) -> Array:
        """(5,) see `light_over_chart`."""
        return np.zeros(5) if self.calibration.falloff is None else self.calibration.falloff[0]

    def applied(self, picture: Array) -> Array:
        """A photograph (h, w, channels) by the same camera in the same light: linear, evenly lit, NaN where clipped."""
        values = np.where(picture >= self.ceilings, np.nan, picture)
        if self.full:
            values = self.full * srgb_decode(255.0 * np.clip(values / self.full, 0.0, 1.0))
        linear = np.stack([self.calibration.linear(values[..., k], k) for k in range(values.shape[2])], axis=2)
        return linear / self._light(*picture.shape[:2])[0][..., None] if self.falloff.any() else linear

    def spread(self, mask: NDArray[np.bool_]) -> float:
        """Relative standard deviation of the light on a region, as the light beside the chart is extrapolated."""
        if not self.falloff.any():
            return 0.0
        light, straight = self._light(*mask.shape)
        return 0.5 * abs(float(np.log(light[mask] / straight[mask]).mean()))

    def _light(self, height: int, width: int) -> tuple[Array, Array]:
        """(h, w) light over its mean on the chart; and as it would be if ln light went on straight at its edge."""
        import cv2

        ends = np.array([[-EDGE_X, -EDGE_Y], [EDGE_X, -EDGE_Y], [EDGE_X, EDGE_Y], [-EDGE_X, EDGE_Y]], np.float32)
        onto = cv2.getPerspectiveTransform(self.corners.astype(np.float32), ends)
        pixels = np.stack(np.meshgrid(np.arange(width) + 0.5, np.arange(height) + 0.5), axis=2)
        place = cv2.perspectiveTransform(pixels.reshape(1, -1, 2), onto).reshape(height, width, 2)
        x, y = np.clip(place, -FARTHEST, FARTHEST).transpose(2, 0, 1)
        inner_x, inner_y = np.clip(x, -EDGE_X, EDGE_X), np.clip(y, -EDGE_Y, EDGE_Y)
        across, down, xx, xy, yy = self.falloff
        along = (across + 2.0 * xx * inner_x + xy * inner_y) * (x - inner_x)
        along = along + (down + xy * inner_x + 2.0 * yy * inner_y) * (y - inner_y)
        straight = np.log(light_over_chart(self.falloff, inner_x, inner_y)) + along
        curved = np.log(light_over_chart(self.falloff, x, y))
        limits = -LARGEST_STEP, LARGEST_STEP
        return np.exp(np.clip(curved, *limits)), np.exp(np.clip(straight, *limits))

    def remarks(self) -> list[str]:
        """A line for each fault that was found."""
        return [*([SRGB] if self.full else []), *self.calibration.remarks()]


def chart_correction(
    photograph: Array, lamp: Spectrum, patches: Sequence[Spectrum], corners: ArrayLike | None, name: str
) -> ChartCorrection:
    """What the chart in `photograph` shows; name: of the photograph in what is said."""
    given = None if corners is None else [corners]
    calibration, (reading,) = read_response([photograph], [lamp], patches, given, [name])
    ceilings = np.full(len(calibration.response.channels), np.inf)
    for k, channel in enumerate(calibration.response.channels):
        clipped = [] if calibration.doubtful is None else calibration.doubtful.clipped[channel]
        if len(clipped):
            ceilings[k] = NEAR_TOP * np.nanmax(reading.values[:, k])
    full = 0.0
    if any(one is not None and one.bent for one in calibration.transfers):
        white = 1.0 if np.nanmax(photograph) <= 1.0 else float(np.iinfo(np.uint16).max)
        decoded = white * srgb_decode(255.0 * np.clip(photograph / white, 0.0, 1.0))
        coded, _ = read_response([decoded], [lamp], patches, [reading.corners], [name])
        if coded.noise.mean() < calibration.noise.mean() and not any(t is not None and t.bent for t in coded.transfers):
            calibration, full = coded, white
    return ChartCorrection(calibration, full, ceilings, reading.corners)
