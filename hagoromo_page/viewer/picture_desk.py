"""Picture desk: flat pictures in a viewer, without a scene: what is shown of them, and where each viewer looks.

A viewer's camera stands before the picture as before a wall: nearer is larger, shifted is shifted.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import inverse_pose
from hagoromo.camera.response import Response
from hagoromo.files.png import write_png
from hagoromo.image.picture.image import auto_exposure
from hagoromo.light.spectrum import Spectrum
from hagoromo_page.viewer.controls import (
    AS_STATED,
    ILLUMINANTS,
    MOST_STOPS,
    NEUTRAL,
    RESPONSES,
    Choice,
    Control,
    Slider,
)
from hagoromo_page.viewer.development import toned, tones
from hagoromo_page.viewer.plates import Plate, PlateLight
from hagoromo_page.viewer.probe import Probe
from hagoromo_page.viewer.view_state import History, ViewTransform
from hagoromo_page.viewer.watcher import LONGEST_SIDE, SHORTEST_SIDE, ShownPicture

KEPT_PLATES = 3  # photographs of a capture that stay in memory
THE_EYE = "the eye"


@dataclass(frozen=True)
class PictureState:
    """What is shown. plate: its name. stops: of each lamp; spectra: names in place of the lamps' own. response: name of
    a camera, in place of the eye. towards: (x, y) to the lamp over a measurement's maps.
    """

    plate: str
    development: ViewTransform = field(default_factory=ViewTransform)
    stops: Mapping[int, float] = field(default_factory=dict)
    spectra: Mapping[int, str] = field(default_factory=dict)
    response: str = THE_EYE
    towards: tuple[float, float] = (-0.5, 0.5)

    def light(self) -> PlateLight:
        """As plates take it."""
        strengths = {k: 0.0 if one <= -MOST_STOPS else 2.0**one for k, one in self.stops.items() if one}
        spectra = {
            k: Spectrum.constant(1.0) if name == NEUTRAL else Spectrum.named(name)
            for k, name in self.spectra.items()
            if name != AS_STATED
        }
        response = None if self.response == THE_EYE else Response.load(self.response)
        return PlateLight(strengths, spectra, response, self.towards)


class PictureDesk:
    """The pictures on the table, which all viewers see and develop."""

    hint = "Right button: shift. Wheel: nearer. Click: probe."
    has_scene = False

    def __init__(self, path: Path, plates: Mapping[str, Callable[[], Plate]]) -> None:
        """`plates`: name → what reads it. path: of what was opened; pictures are saved beside it."""
        self.path, self._plates, self.photographs = path, plates, {}
        self._held: OrderedDict[str, Plate] = OrderedDict()
        self.history: History[PictureState] = History(PictureState(next(iter(plates))))
        self.factors: dict[tuple[str, str], float] = {}  # on linear values at 0 stops, metered once for each layer

    @property
    def state(self) -> PictureState:
        """The present state."""
        return self.history.now

    @property
    def plate(self) -> Plate:
        """The present plate."""
        name = self.state.plate
        if name not in self._held:
            self._held[name] = self._plates[name]()
        self._held.move_to_end(name)
        while len(self._held) > KEPT_PLATES:
            self._held.popitem(last=False)
        return self._held[name]

    @property
    def layer(self) -> str:
        """The layer that is shown."""
        layer = self.state.development.layer
        return layer if layer in self.plate.layers else self.plate.layers[0]

    @property
    def camera(self) -> Camera:
        """Before the picture: a metre is its longer side, and it fills the view."""
        width, height = self.plate.size
        focal = float(max(width, height))
        return Camera(width, height, (focal, focal), (0.5 * width, 0.5 * height)).look_at((0, -1, 0), (0, 0, 0))

    @property
    def middle(self) -> NDArray[np.float64]:
        """(3,) of the picture."""
        return np.zeros(3)

    target = middle

    def edit(self, state: PictureState, name: str) -> None:
        """Make `state` the present one; `InputError`, and nothing changes, for a picture that cannot be read."""
        before = self.history.now
        self.history.now = state
        try:
            self.plate  # noqa: B018 - read it now
        finally:
            self.history.now = before
        self.history.put(state, name)

    def undo(self) -> str | None:
        """Take the last edit back; its name."""
        return self.history.undo()

    def redo(self) -> str | None:
        """Make again what was taken back last; its name."""
        return self.history.redo()

    def watcher(self) -> PictureWatcher:
        """A new viewer."""
        return PictureWatcher(self)

    def controls(self, first: PictureState) -> list[Control]:
        """What can be set; first: the state that was opened."""
        plate, found = self.plate, []
        if len(self._plates) > 1:
            found.append(_of_state("plate", "photograph", Choice(tuple(self._plates))))
        found += [
            _of_development("layer", "layer", Choice(plate.layers)),
            _of_development("stops", "exposure [stops]", Slider(-MOST_STOPS, MOST_STOPS, 0.1)),
            *([] if plate.turns else [_of_development("white", "white", Choice(("first lamp", *ILLUMINANTS)))]),
            _of_development("tone", "tone curve", Choice(tones(self.state.development.ocio))),
        ]
        for number, name in enumerate(plate.lamps):
            if number == 0:
                found.append(_of_state("response", "camera response", Choice((THE_EYE, *RESPONSES[2:]))))
            found += _lamp_controls(number, f"Lamp {number + 1} {name}")
        if plate.turns:
            found += [_towards(0, "to the right"), _towards(1, "upwards")]
        return found

    def save(self) -> Path:
        """Write the picture in its full size, as it is shown, as a PNG of a new name; its path."""
        stem = self.path.stem or self.path.name
        for number in range(1, 10_000):
            path = self.path.parent / f"{stem}-view{number}.png"
            if not path.exists():
                break
        write_png(path, self.developed(self.plate), srgb=True)
        return path

    def developed(self, plate: Plate) -> NDArray[np.uint8]:
        """The display values of the present plate, or of a part of it."""
        layer, state = self.layer, self.state
        linear = plate.linear(layer, state.light(), state.development)
        if linear is None:
            return plate.coded(layer)
        return toned(linear, state.development, self._factor(layer))

    def _factor(self, layer: str) -> float:
        """On linear values at 0 stops, of the whole plate in the light of its first look."""
        key = self.state.plate, layer
        if key not in self.factors:
            width, height = self.plate.size
            small = self.plate.part(slice(0, height), slice(0, width), _within(LONGEST_SIDE, width, height))
            linear = small.linear(layer, self.state.light(), self.state.development)
            assert linear is not None
            self.factors[key] = auto_exposure(linear, small.cover)
        return self.factors[key]


class PictureWatcher:
    """One viewer at a picture desk."""

    against, wipe, differs = None, 0.0, False

    def __init__(self, desk: PictureDesk, longest: int = LONGEST_SIDE) -> None:
        self.desk, self.longest = desk, longest
        self.pose: NDArray[np.float64] | None = None  # of its camera; None: the whole picture
        self._window = (0, 0)
        self._shown: tuple[Any, ...] = ()
        self._part: tuple[Any, Plate] | None = None  # of the plate, with what it is of

    def look_from(self, world_to_camera: NDArray[np.float64]) -> None:
        """Look from a (4, 4) pose."""
        self.pose = world_to_camera

    def fit(self, width: int, height: int) -> None:
        """Its window is width × height px: another shape is sent anew."""
        self._window = width, height
        self.longest = int(np.clip(max(width, height), SHORTEST_SIDE, LONGEST_SIDE))

    @property
    def seen(self) -> tuple[slice, slice]:
        """Rows and columns of the plate that it sees: all, or as many as its camera is near."""
        width, height = self.desk.plate.size
        if self.pose is None:
            return slice(0, height), slice(0, width)
        place, ahead = inverse_pose(self.pose)[:3, 3], self.pose[2, :3]
        away = float(-place[1] / ahead[1]) if ahead[1] > 1e-3 else 1.0  # to the picture, which lies in y = 0
        near = float(np.clip(away, 1e-3, 1.0))
        aim = place + away * ahead
        across, down = 0.5 * width + aim[0] * max(width, height), 0.5 * height - aim[2] * max(width, height)
        return _window(down, near * height, height), _window(across, near * width, width)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height of its picture [px]."""
        rows, columns = self.seen
        return _within(self.longest, columns.stop - columns.start, rows.stop - rows.start)

    def next(self) -> ShownPicture | None:
        """Its next picture; None where the last one stands."""
        rows, columns = self.seen
        part = self.desk.state.plate, (rows.start, rows.stop), (columns.start, columns.stop), self.size
        of = part, self.desk.state, self._window
        if of == self._shown:
            return None
        self._shown = of
        if self._part is None or self._part[0] != part:
            self._part = part, self.desk.plate.part(rows, columns, self.size)
        return ShownPicture(self.desk.developed(self._part[1]), True)

    def probe(self, x: float, y: float) -> Probe | None:
        """What stands at shares (x, y) of its picture's width and height."""
        rows, columns = self.seen
        plate = self.desk.plate
        across = columns.start + x * (columns.stop - columns.start)
        down = rows.start + y * (rows.stop - rows.start)
        return plate.probe(across / plate.size[0], down / plate.size[1], self.desk.state.light())


def _within(longest: int, width: int, height: int) -> tuple[int, int]:
    """Width and height, shrunk so that neither is above `longest`."""
    share = min(longest / max(width, height), 1.0)
    return max(round(width * share), 1), max(round(height * share), 1)


def _window(middle: float, length: float, size: int) -> slice:
    """`length` px about `middle`, within `size`."""
    count = int(np.clip(round(length), min(SHORTEST_SIDE, size), size))
    start = int(np.clip(round(middle - 0.5 * count), 0, size - count))
    return slice(start, start + count)


def _of_state(key: str, label: str, kind: Choice) -> Control:
    return Control(
        key,
        "Picture",
        label,
        kind,
        lambda state: getattr(state, key),
        lambda state, value: replace(state, **{key: value}),
    )


def _of_development(key: str, label: str, kind: Slider | Choice) -> Control:
    def put(state: PictureState, value: Any) -> PictureState:
        return replace(state, development=replace(state.development, **{key: value}))

    return Control(key, "Picture", label, kind, lambda state: getattr(state.development, key), put)


def _lamp_controls(number: int, folder: str) -> list[Control]:
    """Strength and spectrum of a lamp group."""

    def control(key: str, label: str, kind: Slider | Choice, default: Any) -> Control:
        return Control(
            f"{folder} {key}", folder, label, kind,
            lambda state: getattr(state, key).get(number, default),
            lambda state, value: replace(state, **{key: {**getattr(state, key), number: value}}),
        )  # fmt: skip

    return [
        control("stops", "strength [stops]", Slider(-MOST_STOPS, MOST_STOPS, 0.1), 0.0),
        control("spectra", "spectrum", Choice((AS_STATED, NEUTRAL, *ILLUMINANTS)), AS_STATED),
    ]


def _towards(axis: int, label: str) -> Control:
    def put(state: PictureState, value: float) -> PictureState:
        towards = list(state.towards)
        towards[axis] = float(value)
        return replace(state, towards=(towards[0], towards[1]))

    return Control(f"lamp {label}", "Lamp", label, Slider(-1.0, 1.0, 0.01), lambda state: state.towards[axis], put)
