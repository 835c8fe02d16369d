"""Heights panel: heights of a measured surface between two clicks of one viewer, with their 95 % band."""

from __future__ import annotations

from typing import Any

import numpy as np

from hagoromo.measurement.inspection.profile import HeightProfile
from hagoromo_page.viewer.maps_plate import MapsPlate
from hagoromo_page.viewer.panel import value_set
from hagoromo_page.viewer.probe import Probe, plain

BEGIN, END = "Click where the line begins.", "Click where it ends."
INKS = "", "#ffb000", "#ffb00060", "#ffb00060"


class HeightsPanel:
    """A folder of the panel of one viewer, `client` of viser. found: the last profile."""

    def __init__(self, client: Any, plate: MapsPlate, queued: Any) -> None:
        """`queued`: what makes callbacks of viser wait for their turn."""
        self.client, self.plate = client, plate
        self.on = False
        self.start: Probe | None = None
        self.found: HeightProfile | None = None
        self.folder = client.gui.add_folder("Heights", expand_by_default=False)
        with self.folder:
            client.gui.add_checkbox("between two clicks", False).on_update(queued(self.switch, value_set))
            self.said, self.plot = client.gui.add_markdown("Heights along a line, over its chord."), None

    def switch(self, on: bool) -> None:
        """Take clicks as ends of lines, or no longer."""
        self.on, self.start = on, None
        if on:
            self.said.content = BEGIN

    def clicked(self, place: Probe) -> None:
        """A click: the first end of a line, or the second; `InputError` where there is no line between them."""
        if not self.on:
            return
        start, self.start = self.start, None
        if start is None:
            self.start, self.said.content = place, END
            return
        self.said.content = BEGIN
        self.found = self.plate.heights(start, place)
        self.said.content = plain("; ".join((self.found.sentence, *self.found.remarks)))
        self._draw(self.found)

    def _draw(self, found: HeightProfile) -> None:
        from viser import uplot

        known = found.known
        height = found.height[known]
        ends = (np.where(np.isfinite(one[known]), one[known], height) for one in found.band_95)  # a line without a band
        data = found.distance[known], height, *ends
        if self.plot is not None:
            self.plot.data = data
            return
        names = f"distance [{found.unit}]", f"height [{found.unit}]", "95 % from", "95 % to"
        series = tuple(uplot.Series(label=name, stroke=ink) for name, ink in zip(names, INKS, strict=True))
        band, scales = uplot.Band(series=(3, 2), fill="#ffb00030"), {"x": uplot.Scale(time=False)}
        with self.folder:
            self.plot = self.client.gui.add_uplot(data, series, scales=scales, bands=(band,), aspect=1.4)
