"""Own panel: what each viewer has alone: its camera in numbers, its probe, and what it writes."""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import inverse_pose
from hagoromo.errors import InputError
from hagoromo.image.render import render
from hagoromo.image.scene.scene_file import load_scene
from hagoromo_page.viewer.heights_panel import HeightsPanel
from hagoromo_page.viewer.maps_plate import MapsPlate
from hagoromo_page.viewer.panel import value_set
from hagoromo_page.viewer.photographs import LARGEST_DIFFERENCE, through
from hagoromo_page.viewer.picture_desk import PictureDesk, PictureWatcher
from hagoromo_page.viewer.probe import WAVELENGTHS, Probe, probe_text
from hagoromo_page.viewer.watcher import Watcher

NONE = "none"
JUMP_S = 2.0  # after which a camera that did not arrive is where it says


class OwnPanel:
    """The panel of one viewer, `client` of viser, whose pictures are those of `watcher`."""

    def __init__(self, client: Any, watcher: Watcher | PictureWatcher, panel: Any) -> None:
        """`panel`: the one that all viewers share, which says what was done."""
        self.client, self.watcher, self.panel = client, watcher, panel
        self.last: Probe | None = None
        self.aim: NDArray[np.float64] | None = None  # place to which the camera jumps
        self.jumped_at = 0.0
        gui, queued = client.gui, panel.queued
        has_scene = watcher.desk.has_scene
        self.places: list[Any] = []  # of the camera and its target, in numbers
        if has_scene:
            with gui.add_folder("Camera", expand_by_default=False):
                self._add_camera(gui)
                if watcher.desk.photographs:
                    self._add_photographs(gui)
        self.folder = gui.add_folder("Probe", expand_by_default=False)
        with self.folder:
            self.said = gui.add_markdown("Click into the picture.")
            self.plot: Any = None
        plate = watcher.desk.plate if isinstance(watcher.desk, PictureDesk) else None
        self.heights: HeightsPanel | None = None
        if isinstance(plate, MapsPlate) and plate.look is not None:
            self.heights = HeightsPanel(client, plate, queued)
        with gui.add_folder("Write", expand_by_default=False):
            if has_scene:
                gui.add_button("write scene.toml").on_click(queued(lambda _: self.write(False)))
            else:
                gui.add_button("the whole picture").on_click(queued(lambda _: self.jump(watcher.desk.camera)))
            gui.add_button("save picture").on_click(queued(lambda _: self.write(True)))

    def _add_camera(self, gui: Any) -> None:
        """The camera in numbers."""
        queued, desk = self.panel.queued, self.watcher.desk
        eye = gui.add_vector3("eye [m]", tuple(desk.camera.position), step=1e-4)
        target = gui.add_vector3("target [m]", tuple(desk.middle), step=1e-4)
        gui.add_button("look from there").on_click(queued(self.look, lambda _: (eye.value, target.value)))
        gui.add_button("the scene's camera").on_click(queued(lambda _: self.jump(desk.camera)))
        self.places = [eye, target]

    def _add_photographs(self, gui: Any) -> None:
        """Cameras to jump to, and what their photographs are held against."""
        queued = self.panel.queued
        names = gui.add_dropdown("photograph", (NONE, *self.watcher.desk.photographs))
        names.on_update(queued(self.hold_against, value_set))
        wipe = gui.add_slider("photograph | picture", 0.0, 1.0, 0.01, 0.5)
        wipe.on_update(queued(lambda value: setattr(self.watcher, "wipe", value), value_set))
        differs = gui.add_checkbox(f"ΔE00, {LARGEST_DIFFERENCE:g} is white", False)
        differs.on_update(queued(lambda value: setattr(self.watcher, "differs", value), value_set))
        self.watcher.wipe = 0.5

    def hold_against(self, name: str) -> None:
        """Look through the camera of a photograph, and hold the picture against it."""
        watcher = self.watcher
        assert isinstance(watcher, Watcher)
        watcher.against = watcher.desk.photographs.get(name)
        if watcher.against is None:
            return
        try:
            watcher.desk.edit(through(watcher.desk.state, watcher.against.camera), f"camera of {name}")
        except InputError as error:
            self.panel.say(f"not done: {error}")
            return
        self.panel.refresh()
        self.jump(watcher.desk.camera)

    def look(self, eye: Any, target: Any) -> None:
        """Look from `eye` at `target`, +z up."""
        try:
            self.jump(self.watcher.desk.camera.look_at(eye, target), target)
        except InputError as error:
            self.panel.say(f"not done: {error}")

    def jump(self, camera: Camera, target: Any = None) -> None:
        """Look from where `camera` stands."""
        place, axes = camera.position, camera.world_to_camera
        depth = float(axes[2, :3] @ (self.watcher.desk.middle - place))
        aim = place + axes[2, :3] * (depth if depth > 0.0 else 1.0) if target is None else np.asarray(target)
        self.watcher.look_from(camera.world_to_camera)
        self.aim, self.jumped_at = place, time.monotonic()
        own = self.client.camera
        with self.client.atomic():
            own.up_direction, own.position, own.look_at = -axes[1, :3], place, aim

    def moved(self, world_to_camera: NDArray[np.float64]) -> None:
        """The viewer's camera moved to a (4, 4) pose.

        A browser says where its camera was before it hears that it jumped: that is not heeded for a moment.
        """
        if self.aim is not None:
            there = np.allclose(inverse_pose(world_to_camera)[:3, 3], self.aim, rtol=1e-4, atol=1e-6)
            if not there and time.monotonic() - self.jumped_at < JUMP_S:
                return
            self.aim = None
            if there:
                return
        self.watcher.look_from(world_to_camera)
        camera = self.client.camera
        for widget, value in zip(self.places, (camera.position, camera.look_at), strict=False):
            widget.value = tuple(np.round(value, 6).tolist())

    def clicked(self, x: float, y: float) -> None:
        """A click at shares (x, y) of the window."""
        width, height = self.watcher.size
        aspect, own = self.client.camera.aspect, width / height
        x, y = (0.5 + (x - 0.5) * max(aspect / own, 1.0), 0.5 + (y - 0.5) * max(own / aspect, 1.0))
        if not (0.0 <= x < 1.0 and 0.0 <= y < 1.0):
            return
        found = self.watcher.probe(x, y)
        if found is None:
            self.said.content = "The probe reads the picture: choose a layer of light."
            return
        before, self.last = self.last, found
        self.said.content = probe_text(self.last, before)
        self._draw(self.last, before)
        if self.heights is not None:
            self.heights.clicked(found)

    def _draw(self, now: Probe, before: Probe | None) -> None:
        """The spectra of this click and the one before, and the band of this one."""
        from viser import uplot

        known = np.isfinite(now.values)
        if self.plot is not None:
            self.plot.visible = bool(known.any())
        if not known.any():
            return
        before = before or now
        low, high = (now.values if one is None else one for one in (now.low, now.high))
        curves = [now.values, before.values, low, high]
        data = (WAVELENGTHS[known], *(np.nan_to_num(values[known]) for values in curves))
        if self.plot is not None:
            self.plot.data = data
            return
        names = ("λ [nm]", "now", "before", "95 % from", "95 % to")
        inks = ("", "#ffb000", "#648fff", "#ffb00060", "#ffb00060")
        series = tuple(uplot.Series(label=name, stroke=ink) for name, ink in zip(names, inks, strict=True))
        band = uplot.Band(series=(4, 3), fill="#ffb00030")
        scales = {"x": uplot.Scale(time=False)}
        with self.folder:
            self.plot = self.client.gui.add_uplot(data, series, scales=scales, bands=(band,), aspect=1.4)

    def write(self, with_picture: bool) -> None:
        """Write the scene as this viewer sees it, and the picture that `render` makes of it; or the picture alone."""
        desk = self.watcher.desk
        try:
            said = f"wrote {desk.save().name}" if isinstance(desk, PictureDesk) else self._write(with_picture)
        except (InputError, OSError) as error:
            said = f"not done: {error}"
        self.panel.say(said)

    def _write(self, with_picture: bool) -> str:
        """What was written of a scene."""
        assert isinstance(self.watcher, Watcher)
        path = self.watcher.desk.files.write(self.watcher.state())
        if not with_picture:
            return f"wrote {path.name}"
        self.panel.say(f"wrote {path.name}; renders it …")
        made = render(*load_scene(path)).save(  # without a shutter, as the window shows it
            path.with_suffix(".exr"), self.watcher.desk.camera.response
        )
        return f"wrote {', '.join(one.name for one in (path, *made))}"
