"""Settings: how a scene is rendered."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from hagoromo import __version__
from hagoromo.backend import name as backend_name
from hagoromo.errors import InputError
from hagoromo.image.scene.cut import Cut, checked_cut
from hagoromo.image.scene.modes import MODES, SHADOWS, Mode, Shadows
from hagoromo.image.scene.scene import Scene
from hagoromo.transport.frames import DEFAULT_TOLERANCE

MOST_SAMPLES = 1 << 16  # rays a pixel: their noise is a 256th of that of one
FINEST_SHADOWS = 16384  # texels a side of a shadow map
MOST_FULL_WALKS = 1 << 28  # in a picture of mode full
LONGEST = 1e7  # time that a picture may take [s]


@dataclass(frozen=True)
class Settings:
    """How to render: samples are rays a pixel, shadow_resolution is texels a side of a map (None: fitting).

    tolerance: of the picture, root mean square over its mean where there is matter. A step of the march is a cell
    between eight voxel centres, or a part of it; how deep and long it may be, and where a march replaces shadow maps,
    follows the tolerance. separate_lamps: whether every lamp has weights of its own, so that its strength and colour
    can be changed afterwards (`Image.with_lamps`); otherwise lamps of one spectrum share them. Memory grows with the
    number of lamps, and time a little.

    cut: (n_x, n_y, n_z, d), a plane: of mode march; the camera sees what lies at n · x ≥ d [m], world. Light is not
    cut.

    Of modes path and full: orders are those of light at most, 1 being light that is scattered once; None: all of them.
    error is where to stop, root mean square over the mean where there is matter, which 19 of 20 pictures are below: of
    Y, in mode path of its noise, in mode full of blocks of 8 × 8 pixels, see `FullError`. seconds is for how long to
    walk, about: how many walks those are differs from run to run. Of mode path: pixels with more noise around them get
    more walks; with error or seconds `samples` is the least number of walks a pixel.

    Of mode full: walks are those that state and mend its error, about, in the whole picture; None: as many as bring it
    to `error`, or are made in `seconds`, or bring it to 1 %, 2^20 at most; 0: none, so that it states none, as the
    other modes do. An error that takes more than ten minutes is refused unless seconds are given.

    >>> hg.Settings(samples=16, tolerance=0.02).shadows
    'map'
    >>> hg.Settings(samples=0)
    Traceback (most recent call last):
    ...
    hagoromo.errors.InputError: samples is 0: give 1 to 65536 rays a pixel
    """

    samples: int = 1
    shadows: Shadows = "map"
    shadow_resolution: int | None = None
    tolerance: float = DEFAULT_TOLERANCE
    seed: int = 0
    separate_lamps: bool = False
    orders: int | None = None
    error: float | None = None
    seconds: float | None = None
    walks: int | None = None
    cut: Cut | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "cut", checked_cut(self.cut))
        if not 1 <= self.samples <= MOST_SAMPLES:
            raise InputError(f"samples is {self.samples}: give 1 to {MOST_SAMPLES} rays a pixel")
        if self.shadows not in SHADOWS:
            raise InputError(f"shadows is {self.shadows!r}: give one of {', '.join(SHADOWS)}")
        if not 1e-4 <= self.tolerance <= 1:
            raise InputError(f"tolerance is {self.tolerance}: give a number from 1e-4 to 1")
        if self.orders is not None and self.orders < 1:
            raise InputError(f"orders is {self.orders}: give 1 or more, or leave it out for all orders of light")
        if self.error is not None and not 1e-4 <= self.error <= 1:
            raise InputError(f"error is {self.error}: give a number from 1e-4 to 1, such as 0.01")
        if self.seconds is not None and not 0 < self.seconds <= LONGEST:
            raise InputError(f"seconds is {self.seconds}: give a time above 0 and up to {LONGEST:g} s")
        if self.walks is not None and not 0 <= self.walks <= MOST_FULL_WALKS:
            raise InputError(f"walks is {self.walks}: give 0 to {MOST_FULL_WALKS} random walks in all")
        if self.walks is not None and self.error is not None:
            raise InputError("both walks and error are given: give the number of walks, or the error that they bring")
        if self.walks is not None and self.seconds is not None:
            raise InputError("both walks and seconds are given: give the number of walks, or the time that they take")
        if self.shadow_resolution is not None and not 2 <= self.shadow_resolution <= FINEST_SHADOWS:
            raise InputError(f"shadow_resolution is {self.shadow_resolution}: give 2 to {FINEST_SHADOWS} texels")


def check_mode(settings: Settings, mode: Mode) -> None:
    """`InputError` for a mode that there is not, and for settings that the mode does not heed."""
    if mode not in MODES:
        raise InputError(f"mode is {mode!r}: give one of {', '.join(MODES)}")
    if settings.cut is not None and mode != "march":
        raise InputError(f"a cut is for mode march, and the mode is {mode}: leave the cut out, or render by march")
    heeding: dict[str, tuple[Mode, ...]] = {
        "orders": ("path", "full"), "error": ("path", "full"), "seconds": ("path", "full"), "walks": ("full",)
    }  # fmt: skip
    for key, modes in heeding.items():
        if getattr(settings, key) not in (None, 0) and mode not in modes:
            names = " and ".join(modes)
            raise InputError(
                f"{key} is for mode {names}, and the mode is {mode}: leave it out, or render by {modes[0]}"
            )


def metadata(scene: Scene, settings: Settings) -> dict[str, Any]:
    """Metadata of an image: version, backend, settings and scene, as plain values."""
    return {"version": __version__, "backend": backend_name(), "settings": asdict(settings), "scene": scene.record()}
