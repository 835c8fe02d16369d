"""Size of the demo: of its photographs, its boxes and its pictures."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from hagoromo_matter.demo.figures import PAPER_FIGURES


@dataclass(frozen=True)
class Size:
    """Size of the demo: binning and rays per pixel of capture and figures; resolution and names of the figures.

    without: parts that no figure has.
    """

    capture_binning: int
    capture_samples: int
    figure_binning: int
    figure_samples: int
    resolution: float
    figures: tuple[str, ...] = tuple(PAPER_FIGURES)
    seed: int = 1
    without: tuple[str, ...] = ()

    def of_figures(self) -> dict[str, Any]:
        """What every figure depends on."""
        record = asdict(self)
        return {key: record[key] for key in ("figure_binning", "figure_samples", "resolution", "seed", "without")}

    def of_capture(self) -> dict[str, Any]:
        """What photographs and measurement depend on."""
        record = asdict(self)
        return {key: record[key] for key in ("capture_binning", "capture_samples", "seed")}


SIZES = {
    "tiny": Size(
        capture_binning=8,
        capture_samples=1,
        figure_binning=16,
        figure_samples=1,
        resolution=0.4,
        figures=("figure_7_skin",),
        without=("habit", "linen", "veil"),  # to drape and weave them takes most of the time
    ),
    "small": Size(capture_binning=2, capture_samples=4, figure_binning=4, figure_samples=2, resolution=0.5),
    "full": Size(capture_binning=2, capture_samples=4, figure_binning=2, figure_samples=4, resolution=1.0),
}
