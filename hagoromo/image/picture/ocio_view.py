"""OCIO view: a view of a display of a configuration of OpenColorIO, an extra, as a function of linear sRGB."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.icc import DISPLAY_P3, SRGB
from hagoromo.files.reading import library

OWN = "ocio://"  # begins the names of OpenColorIO's own configurations
ACES = f"{OWN}studio-config-v4.0.0_aces-v2.0_ocio-v2.5"  # OpenColorIO's own
LINEAR = "Linear Rec.709 (sRGB)"  # as that configuration calls linear sRGB
SCENE_LINEAR = "scene_linear"  # role of the space that a configuration computes in
DATA = "Raw"  # a view that shows numbers, not colours
PROFILES = {"sRGB - Display": SRGB, "sRGB": SRGB, "Display P3 - Display": DISPLAY_P3, "Display P3": DISPLAY_P3}


class OcioConfiguration:
    """The configuration at `place`: a file (.ocio, .ocioz), or one of OpenColorIO's own, ocio://NAME.

    `InputError` where OpenColorIO is not installed, and for a file that it cannot read.
    """

    def __init__(self, place: str = ACES) -> None:
        self.ocio, self.place = library("PyOpenColorIO"), place
        if not place.startswith(OWN):
            existing_file(Path(place))
        try:
            self.config = self.ocio.Config.CreateFromFile(place)
        except Exception as error:
            raise InputError(f"{place} is no configuration of OpenColorIO: {_line(error)}") from error

    @property
    def displays(self) -> dict[str, list[str]]:
        """The views of each display, those that show data left out."""
        return {one: [view for view in self.config.getViews(one) if view != DATA] for one in self.config.getDisplays()}

    def chosen(self, display: str | None, view: str | None) -> tuple[str, str]:
        """The display and the view of these names; by default those of the configuration. `InputError` lists others."""
        displays = self.displays
        display = self.config.getDefaultDisplay() if display is None else display
        if display not in displays:
            raise InputError(f"{self.place} has no display {display!r:.80}: give one of {', '.join(displays)}")
        view = self.config.getDefaultView(display) if view is None else view
        if view not in displays[display]:
            known = ", ".join(displays[display])
            raise InputError(f"{self.place} has no view {view!r:.80} of {display}: give one of {known}")
        return display, view

    def processor(self, display: str, view: str) -> Any:
        """What computes display values in place: `applyRGB` on float32 (…, 3) of linear sRGB."""
        ocio, config = self.ocio, self.config
        try:
            if config.getColorSpace(LINEAR) is not None:
                shown = ocio.DisplayViewTransform(src=LINEAR, display=display, view=view)
                return config.getProcessor(shown).getDefaultCPUProcessor()
            inwards = config.GetProcessorFromBuiltinColorSpace(LINEAR, config, SCENE_LINEAR).createGroupTransform()
            inwards.appendTransform(ocio.DisplayViewTransform(src=SCENE_LINEAR, display=display, view=view))
            return config.getProcessor(inwards).getDefaultCPUProcessor()
        except Exception as error:
            raise InputError(f"{self.place}: {view} of {display} cannot be computed: {_line(error)}") from error


def _line(error: Exception) -> str:
    return " ".join(str(error).split())[:200]
