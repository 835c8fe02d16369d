"""Feather kinds: typical values for the feathers of a bird the size of a pigeon. Lengths in mm."""

from __future__ import annotations

from hagoromo_matter.feather.barb import Barbs
from hagoromo_matter.feather.down import Down
from hagoromo_matter.feather.plume import Plume
from hagoromo_matter.feather.vane import Feather

FEATHERS = {
    "primary": Feather(),
    "secondary": Feather(
        Plume(80.0, 8.5, 13.0, 1.5, 0.17, 0.22, 4.0, 7.0, 2.0),
        Barbs(outer_deg=38.0, splits_per_cm=0.25),
        down=Down(share=0.18),
    ),
    "covert": Feather(
        Plume(32.0, 6.5, 8.5, 0.8, 0.14, 0.4, 2.0, 4.0, 1.2),
        Barbs(2.0, 40.0, 42.0, 10.0, 1.6, 0.04, 0.11, 0.5, 1.0, 0.6),
        down=Down(share=0.35),
    ),
    "contour": Feather(
        Plume(38.0, 9.5, 9.5, 0.6, 0.1, 0.5, 1.0, 6.0, 2.5),
        Barbs(1.7, 42.0, 42.0, 10.0, 1.5, 0.035, 0.09, 0.6, 1.0, 1.2),
        down=Down(share=0.5, loft_mm=2.2),
        after=0.5,
    ),
    "down": Feather(
        Plume(26.0, 12.0, 12.0, 0.35, 0.12, 0.7, 1.0, 3.0, 2.0),
        Barbs(1.6, 48.0, 48.0, 8.0, 1.3, 0.03, 0.05, 0.0, 0.0, 2.0),
        down=Down(share=1.0, loft_mm=3.5),
    ),
}  # fmt: skip
