"""Look: what is estimated beside the object: the light where no lamp is known, and how capture and statement differ."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.choices import PARTS, Part
from hagoromo_recovery.descent.camera_changes import CameraChanges
from hagoromo_recovery.descent.lamp_places import LampPlaces
from hagoromo_recovery.descent.strengths import Strengths
from hagoromo_recovery.outline.object_view import ObjectView
from hagoromo_recovery.shading.unknown_light import Frame, UnknownLight


@dataclass(frozen=True, eq=False)
class Look:
    """unknown: light that depends on the normal. cameras, strengths, places (of lamps): how they differ from what is
    stated. tried: PSNR [dB] of each kind of light that was tried. None: not estimated.
    """

    unknown: UnknownLight | None = None
    cameras: CameraChanges | None = None
    strengths: Strengths | None = None
    places: LampPlaces | None = None
    tried: Mapping[str, float] = field(default_factory=dict)

    def of(self, photograph: Photograph) -> Photograph:
        """A photograph with the camera and the lamps that were found."""
        changed = photograph if self.strengths is None else self.strengths.of(photograph)
        changed = changed if self.places is None else self.places.of(changed)
        return changed if self.cameras is None else self.cameras.of(changed)


@dataclass(frozen=True, eq=False)
class FoundLook:
    """A look as plain data. parts: what is refined. frame, coefficients: of unknown light that depends on the normal.

    cameras, strengths, places: by name, as `CameraChanges`, `Strengths` and `LampPlaces` give them.
    """

    parts: tuple[Part, ...] = ()
    frame: Frame | None = None
    coefficients: NDArray[np.float64] | None = None
    cameras: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    strengths: dict[str, float] = field(default_factory=dict)
    places: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    tried: dict[str, float] = field(default_factory=dict)

    def of_views(self, views: Sequence[ObjectView]) -> Look:
        """The look at some views, which goes on from what was found."""
        photographs, parts = [view.photograph for view in views], self.parts
        light = None if self.frame is None else UnknownLight(self.frame, photographs, self.coefficients)
        moved = "cameras" in parts or "turn" in parts
        cameras = CameraChanges(photographs, "cameras" in parts, self.cameras) if moved else None
        lamps, exposure = "lamps" in parts, "exposure" in parts
        strengths = Strengths(photographs, lamps, exposure, self.strengths) if lamps or exposure else None
        places = LampPlaces(photographs, self.places) if "places" in parts else None
        return Look(light, cameras, strengths, places, self.tried)

    @staticmethod
    def of(look: Look) -> FoundLook:
        """That of a look."""
        light, cameras, strengths, places = look.unknown, look.cameras, look.strengths, look.places
        refined = {
            "turn": cameras is not None and not cameras.each,
            "cameras": cameras is not None and cameras.each,
            "lamps": strengths is not None and strengths.lamps,
            "exposure": strengths is not None and strengths.exposure,
            "places": places is not None,
            "masks": False,  # are moved before all else
        }
        return FoundLook(
            tuple(part for part in PARTS if refined[part]),
            None if light is None else light.frame,
            None if light is None else light.coefficients,
            {} if cameras is None else cameras.changes,
            {} if strengths is None else strengths.logarithms,
            {} if places is None else places.shifts,
            dict(look.tried),
        )
