"""Watcher: one viewer of a scene: from where it looks, and the pictures that it gets, each better than the last.

A `Desk` holds what all viewers share: the edited scene and what it left on the device. Nothing here knows a browser.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.lamp_batches import LAMPS_AT_ONCE
from hagoromo.image.preview import FIRST_SECONDS, Preview
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo_page.viewer.controls import Control, controls
from hagoromo_page.viewer.development import linear_picture, metered, toned
from hagoromo_page.viewer.layers import (
    OF_LIGHT,
    OF_MATTER,
    LayerPicture,
    light_layer,
    matter_pictures,
    opacity_layer,
    shadow_pictures,
)
from hagoromo_page.viewer.photographs import Against, as_bright, difference_map, wiped
from hagoromo_page.viewer.probe import Probe, probe
from hagoromo_page.viewer.scene_files import SceneFiles
from hagoromo_page.viewer.view_state import History, ViewState

LONGEST_SIDE = 1024  # px of a picture in the viewer at most
SHORTEST_SIDE = 16
ROUGHLY = 0.5  # tolerance of the points of a light whose strength is looked at
SAME_PLACE, SAME_TURN = 1e-5, 1e-5  # of the distance, and entries of a rotation: a pose that came back from a browser


class Desk:
    """The scene on the table, which all viewers see and edit."""

    hint = "Drag: turn. Right button: shift. Wheel: nearer. Click: probe."
    has_scene = True

    def __init__(
        self,
        files: SceneFiles,
        state: ViewState,
        photographs: Sequence[Against] = (),
        seconds: float = FIRST_SECONDS,
    ) -> None:
        """`photographs`: to hold pictures against. seconds: until the first picture after a change, about."""
        self.photographs = {one.name: one for one in photographs}
        self.files = files
        self.history: History[ViewState] = History(state)
        self.scene, settings = files.scene(state)
        self.settings = _separate(settings, self.scene)
        self.preview = Preview(self.settings, seconds)
        self.factor: float | None = None  # on linear values at 0 stops, metered once

    @property
    def state(self) -> ViewState:
        """The present state."""
        return self.history.now

    @property
    def camera(self) -> Camera:
        """That of the scene."""
        return self.scene.camera

    @property
    def middle(self) -> NDArray[np.float64]:
        """(3,) of the matter [m]."""
        corners = self.scene.matter_corners()
        return 0.5 * (corners.min(axis=0) + corners.max(axis=0))

    @property
    def target(self) -> NDArray[np.float64]:
        """(3,) [m]: the point on the camera's axis in the middle of the depth of the matter."""
        camera = self.camera
        depth = (self.scene.matter_corners() - camera.position) @ camera.world_to_camera[2, :3]
        middle = 0.5 * (depth.min() + depth.max())
        return camera.position + camera.world_to_camera[2, :3] * (middle if middle > 0.0 else depth.max())

    def strength_of_first_light(self) -> float:
        """The irradiance that it gives on what faces it in the middle of the matter; 1 where that is none."""
        corners, lamps = self.scene.matter_corners(), self.scene.lamps[:1]
        if not lamps:
            lamps = self.scene.wide_lights[0].points(corners.min(axis=0), corners.max(axis=0), ROUGHLY).lamps
        return sum(float(np.max(lamp.direction_and_irradiance(self.middle)[1])) for lamp in lamps) or 1.0

    def controls(self, first: ViewState) -> list[Control]:
        """What can be set; first: the state that was opened."""
        return controls(self.state, first, self.scene)

    def watcher(self) -> Watcher:
        """A new viewer."""
        return Watcher(self)

    def edit(self, state: ViewState, name: str) -> None:
        """Make `state` the present one; `InputError`, and nothing changes, where its tables make no scene."""
        scene, settings = self.files.scene(state)
        self.history.put(state, name)
        self._take(scene, settings)

    def undo(self) -> str | None:
        """Take the last edit back; its name."""
        return self._moved(self.history.undo)

    def redo(self) -> str | None:
        """Make again what was taken back last; its name."""
        return self._moved(self.history.redo)

    def _moved(self, move: Callable[[], str | None]) -> str | None:
        edit = move()
        if edit is not None:
            self._take(*self.files.scene(self.state))
        return edit

    def _take(self, scene: Scene, settings: Settings) -> None:
        self.scene, self.settings = scene, _separate(settings, scene)
        self.preview.settings = self.settings


def _separate(settings: Settings, scene: Scene) -> Settings:
    """The settings with weights for each lamp, unless there are too many lamps for one march, or lights with a size."""
    return replace(settings, separate_lamps=len(scene.lamps) <= LAMPS_AT_ONCE and not scene.has_wide_lights)


@dataclass(frozen=True, eq=False)
class ShownPicture:
    """A picture (height, width, 3) uint8; last: whether none better follows."""

    picture: NDArray[np.uint8]
    last: bool


class Watcher:
    """One viewer at the desk."""

    def __init__(self, desk: Desk, longest: int = LONGEST_SIDE) -> None:
        """`longest`: px of its pictures along the longer side, at most."""
        self.desk, self.longest = desk, longest
        self.pose: NDArray[np.float64] | None = None  # of its camera; None: that of the scene
        self.image: Image | None = None
        self.layer: LayerPicture | None = None  # in place of the image
        self.against: Against | None = None  # the photograph that was taken from where it looks
        self.wipe, self.differs, self.brightness = 0.0, False, 1.0
        self._pictures: Iterator[Image | LayerPicture] = iter(())
        self._window = (0, 0)
        self._of: tuple[Any, ...] = ()  # what the pictures are of
        self._marched: Scene | None = None
        self._shown: tuple[Any, ...] = ()

    def look_from(self, world_to_camera: NDArray[np.float64]) -> None:
        """Look from a (4, 4) pose; one that differs from the scene camera's by rounding only is that."""
        own = self.desk.scene.camera.world_to_camera
        turned, moved = np.abs(world_to_camera - own)[:3, :3].max(), np.abs(world_to_camera - own)[:3, 3].max()
        near = turned < SAME_TURN and moved < SAME_PLACE * max(float(np.linalg.norm(own[:3, 3])), 1e-9)
        self.pose = None if near else world_to_camera

    def fit(self, width: int, height: int) -> None:
        """Its window is width × height px: no more pixels are seen, and another shape is sent anew."""
        self.longest = int(np.clip(max(width, height), SHORTEST_SIDE, LONGEST_SIDE))
        if (width, height) != self._window:
            self._window, self._shown = (width, height), ()

    def state(self) -> ViewState:
        """The desk's state from where it looks."""
        return self.desk.state if self.pose is None else self.desk.state.with_pose(self.pose)

    def scene(self) -> Scene:
        """The desk's scene from where it looks, in its size; `InputError` where it looks at nothing."""
        camera = self.desk.scene.camera.limited(self.longest)
        return self.desk.scene.with_camera(camera if self.pose is None else camera.with_pose(self.pose))

    def next(self) -> ShownPicture | None:
        """Its next picture; None where the last one stands. `InputError` where it looks at nothing."""
        self._begin()
        new = next(self._pictures, None)
        if isinstance(new, Image):
            self.image, self.layer = new, None
        elif new is not None:
            self.layer = new
        of = self.desk.state.tables, self.desk.state.development, self.against, self.wipe, self.differs
        if (self.image is None and self.layer is None) or (new is None and self._shown == of):
            return None
        self._shown = of
        if self.layer is not None:
            return ShownPicture(self.layer.picture, self.layer.share >= 1.0)
        assert self.image is not None
        return ShownPicture(self._developed(self.image), self.image.metadata["preview"]["share"] >= 1.0)

    def probe(self, x: float, y: float) -> Probe | None:
        """What stands at shares (x, y) of its picture's width and height; None where the picture is no light."""
        image = self.relit()
        return None if image is None else probe(image, x, y)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its picture [px]."""
        camera = self.desk.camera.limited(self.longest)
        return camera.width, camera.height

    def relit(self) -> Image | None:
        """The image that its picture was developed from, under the desk's lamps; None where the picture has none."""
        return None if self.image is None or self.layer is not None else self._relit(self.image)

    def _begin(self) -> None:
        """Begin pictures anew if what is marched has changed."""
        state = self.desk.state
        pose = self.desk.scene.camera.world_to_camera if self.pose is None else self.pose
        layer = state.development.layer
        march = "light" if layer in OF_LIGHT else layer
        strengths = str(state.lamps) if march == "shadow" else ""
        of = march, strengths, state.marched(), pose.tobytes(), self.longest, self.desk.settings
        if of == self._of and self._marched and _same_weights(self._marched, self.desk.scene, self.desk.settings):
            return
        self._of, self._pictures = of, iter(())
        self._marched = self.scene()
        self._pictures = self._pictures_of(march, self._marched)

    def _pictures_of(self, march: str, scene: Scene) -> Iterator[Image | LayerPicture]:
        preview, settings = self.desk.preview, self.desk.settings
        if march in OF_MATTER:
            return matter_pictures(scene, settings, preview.cache, march, preview.rays[False])
        images = preview.pictures(scene)
        return shadow_pictures(images, scene, settings, preview.cache) if march == "shadow" else images

    def _developed(self, image: Image) -> NDArray[np.uint8]:
        desk = self.desk
        image, response, development = self._relit(image), desk.scene.camera.response, desk.state.development
        if desk.factor is None:
            desk.factor = metered(image, development, response)
        if development.layer == "opacity":
            return opacity_layer(image)
        if development.layer != "picture":
            image = light_layer(image, development.layer)
        linear = linear_picture(image, development, response)
        picture = toned(linear, development, desk.factor)
        if self.against is None or self.against.linear is None or self.pose is not None:
            return picture
        photograph, self.brightness = as_bright(self.against.linear, linear)
        if self.differs:
            return difference_map(photograph * desk.factor, linear * desk.factor)
        return wiped(toned(photograph, development, desk.factor), picture, self.wipe)

    def _relit(self, image: Image) -> Image:
        """The image under the desk's strengths and spectra, if they are not those that it was marched under.

        As it is, where a lamp was added or removed since: it is shown until the next march has a picture.
        """
        assert self._marched is not None
        if len(self._marched.lamps) != len(self.desk.scene.lamps):
            return image
        pairs = list(enumerate(zip(self._marched.lamps, self.desk.scene.lamps, strict=True)))
        factors = {
            k: new.intensity / old.intensity
            for k, (old, new) in pairs
            if isinstance(new.intensity, float) and isinstance(old.intensity, float) and new.intensity != old.intensity
        }
        spectra = {k: new.spectrum for k, (old, new) in pairs if not new.spectrum.equals(old.spectrum)}
        return image.with_lamps(factors, spectra) if factors or spectra else image


def _same_weights(marched: Scene, scene: Scene, settings: Settings) -> bool:
    """Whether weights under the lamps of one scene give those of the other, times a factor for each lamp.

    A lamp that was marched at 0 has none, and lamps that share weights have no factors of their own.
    """
    changed = [
        old.intensity
        for old, new in zip(marched.lamps, scene.lamps, strict=True)
        if old.intensity != new.intensity or not old.spectrum.equals(new.spectrum)
    ]
    return not changed or (settings.separate_lamps and all(isinstance(one, float) and one > 0.0 for one in changed))
