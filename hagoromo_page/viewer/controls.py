"""Controls: what can be set in a viewer, each as a value of the state and the state with another value.

Nothing here knows a browser: `panel.py` draws each control as a widget of its kind.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import WHITE_XYZ, Response, camera_response, camera_white
from hagoromo.image.scene.scene import Scene
from hagoromo.light.colour import srgb_decode, srgb_encode, srgb_from_xyz
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_page.viewer.development import tones
from hagoromo_page.viewer.layers import LAYERS
from hagoromo_page.viewer.view_state import Steps, ViewState

AS_STATED = "as stated"
NEUTRAL = "equal energy"
ILLUMINANTS = ("D65", "D50", "A", "FL2", "FL11", "LED-B3")
RESPONSES = (AS_STATED, "the eye", "canon_eos_300d", "Nikon 5100 (NPL)", "Sigma SDMerill (NPL)")
UNCUT = "none"
CUT_NORMALS = {
    f"{sign}{axis}": tuple((1.0 if sign == "+" else -1.0) * (axis == one) for one in "xyz")
    for axis in "xyz"
    for sign in "+-"
}
MOST_STOPS = 8.0  # of a lamp, and of exposure
LARGEST_SLIDER_BETA = 2.0  # [1/sr]
LARGEST_SLIDER_GAMMA = 60.0  # [°]


@dataclass(frozen=True)
class Slider:
    """A number from `least` to `most` in steps."""

    least: float
    most: float
    step: float


@dataclass(frozen=True)
class Choice:
    """One of some names."""

    names: tuple[str, ...]


@dataclass(frozen=True)
class VectorControl:
    """A vector (3,); gizmo: how far from the middle of the scene the thing stands that is dragged, None where it is."""

    away: float | None = None


@dataclass(frozen=True)
class Colour:
    """Red, green and blue, 0 to 255."""


@dataclass(frozen=True)
class Control:
    """Something that can be set. name: its own, of the edit, too. folder, label: where and as what it is shown."""

    name: str
    folder: str
    label: str
    kind: Slider | Choice | VectorControl | Colour
    get: Callable[[Any], Any]
    put: Callable[[Any, Any], Any]


def controls(state: ViewState, first: ViewState, scene: Scene) -> list[Control]:
    """All controls of a state, whose scene is `scene`; first: the state that was opened."""
    found = [*_picture_controls(state, first), *_cut_controls(scene)]
    for number in range(len(state.lamps)):
        found += _lamp_controls(number, state, first, scene)
    for k, box in enumerate(scene.boxes):
        for m, material in enumerate(box.materials):
            start = _box_materials(k, scene)
            found += _material_controls(f"box {k} material {m}", ("box", k, "materials"), start, m, material)
    for k, surface in enumerate(scene.surfaces):
        start = surface.reflectance.record()
        found += _material_controls(f"surface {k}", ("surface", k, "reflectance"), start, None, surface.reflectance)
    return found


def _picture_controls(state: ViewState, first: ViewState) -> list[Control]:
    """Exposure, white, tone curve, layer and response."""

    def of(key: str, label: str, kind: Slider | Choice) -> Control:
        get = lambda state: getattr(state.development, key)  # noqa: E731
        return Control(key, "Picture", label, kind, get, lambda state, value: state.developed(**{key: value}))

    steps: Steps = ("camera", "response")

    def response(state: ViewState) -> str:
        name = state.at(*steps)
        if name == first.at(*steps):
            return AS_STATED
        return "the eye" if name is None else name

    def with_response(state: ViewState, name: str) -> ViewState:
        value = {AS_STATED: first.at(*steps), "the eye": None}.get(name, name)
        return state.with_value(steps, value)

    return [
        of("layer", "layer", Choice(LAYERS)),
        of("stops", "exposure [stops]", Slider(-MOST_STOPS, MOST_STOPS, 0.1)),
        of("white", "white", Choice(("first lamp", *ILLUMINANTS))),
        of("tone", "tone curve", Choice(tones(state.development.ocio))),
        Control("response", "Picture", "camera response", Choice(RESPONSES), response, with_response),
    ]


def _cut_controls(scene: Scene) -> list[Control]:
    """The plane that the scene is cut by: its normal, an axis of the world, and where it stands."""
    corners = scene.matter_corners()
    low, high = corners.min(axis=0), corners.max(axis=0)
    reach = float(np.abs(corners).max())
    steps: Steps = ("render", "cut")

    def normal(state: ViewState) -> str:
        cut = state.at(*steps)
        return next((name for name, one in CUT_NORMALS.items() if cut and tuple(cut[:3]) == one), UNCUT)

    def with_normal(state: ViewState, name: str) -> ViewState:
        if name == UNCUT:
            return state.with_value(steps, None)
        one = CUT_NORMALS[name]
        return state.with_value(steps, [*one, float(np.dot(one, 0.5 * (low + high)))])

    def place(state: ViewState) -> float:
        cut = state.at(*steps)
        return float(cut[3]) * 1e3 if cut else 0.0

    def with_place(state: ViewState, millimetres: float) -> ViewState:
        cut = state.at(*steps)
        return state if not cut else state.with_value(steps, [*cut[:3], millimetres * 1e-3])

    span = Slider(-1e3 * reach, 1e3 * reach, 2e3 * reach / 400)
    return [
        Control("cut", "Cut", "visible side", Choice((UNCUT, *CUT_NORMALS)), normal, with_normal),
        Control("cut place", "Cut", "place [mm]", span, place, with_place),
    ]


def _lamp_controls(number: int, state: ViewState, first: ViewState, scene: Scene) -> list[Control]:
    """Strength, spectrum and place of a lamp."""
    lamp, at = scene.lamps[number], ("lamp", number)
    folder = f"Lamp {number + 1} {lamp.name}".rstrip()
    stated = first.at(*at, "intensity")
    base = float(stated) if isinstance(stated, (int, float)) and stated > 0 else 1.0
    spectrum_of_file = first.at(*at, "spectrum")

    def stops(state: ViewState) -> float:
        intensity = state.at(*at, "intensity")
        intensity = 1.0 if intensity is None else intensity
        return math.log2(intensity / base) if intensity > 0.0 else -MOST_STOPS

    def with_stops(state: ViewState, value: float) -> ViewState:
        return state.with_value((*at, "intensity"), 0.0 if value <= -MOST_STOPS else base * 2.0**value)

    def spectrum(state: ViewState) -> str:
        value = state.at(*at, "spectrum")
        if value == spectrum_of_file:
            return AS_STATED
        return value if value in ILLUMINANTS else NEUTRAL

    def with_spectrum(state: ViewState, name: str) -> ViewState:
        value = {AS_STATED: spectrum_of_file, NEUTRAL: 1.0}.get(name, name)
        return state.with_value((*at, "spectrum"), value)

    key = lamp.place_key
    corners = scene.matter_corners()
    away = float(np.linalg.norm(np.ptp(corners, axis=0))) if not lamp.near else None
    found = [
        Control(f"{folder} spectrum", folder, "spectrum", Choice((AS_STATED, NEUTRAL, *ILLUMINANTS)),
                spectrum, with_spectrum),
        Control(f"{folder} {key}", folder, "towards it" if away else "place [m]", VectorControl(away),
                lambda state: tuple(map(float, state.at(*at, key))),
                lambda state, value: state.with_value((*at, key), [float(x) for x in value])),
    ]  # fmt: skip
    if isinstance(lamp.intensity, tuple):
        return found
    strength = Slider(-MOST_STOPS, MOST_STOPS, 0.1)
    return [Control(f"{folder} strength", folder, "strength [stops]", strength, stops, with_stops), *found]


def _box_materials(k: int, scene: Scene) -> list[dict[str, Any]]:
    return [material.record() for material in scene.boxes[k].materials]


def _material_controls(what: str, steps: Steps, start: Any, number: int | None, material: Reflectance) -> list[Control]:
    """α, β, γ, ν, n and the colour of a material. start: its tables as the scene has them, all they say written out.

    number: of the material in the list that stands at `steps`; None where the table itself does.
    """
    folder = f"Material {material.name}".rstrip() + f" ({what})"

    def put(key: str, state: ViewState, value: Any) -> ViewState:
        tables = start if number is None else start[number]
        changed = {one: entry for one, entry in (tables | {key: value}).items() if entry is not None}
        if number is None:
            return state.with_value(steps, changed)
        return state.with_value(steps, [*start[:number], changed, *start[number + 1 :]])

    def control(
        key: str, label: str, kind: Slider | Colour, get: Callable[[], Any], back: Callable[[Any], Any]
    ) -> Control:
        return Control(
            f"{what} {key}", folder, label, kind, lambda _: get(), lambda state, value: put(key, state, back(value))
        )

    return [
        control("alpha", "α body [1/sr]", Slider(0.0, 0.318, 0.001), lambda: material.alpha, float),
        control("beta", "β interface [1/sr]", Slider(0.0, LARGEST_SLIDER_BETA, 0.001), lambda: material.beta, float),
        control("gamma", "γ roughness [°]", Slider(0.1, LARGEST_SLIDER_GAMMA, 0.1),
                lambda: math.degrees(material.gamma), math.radians),
        control("nu", "ν tails (0: Gaussian)", Slider(0.0, 20.0, 0.1),
                lambda: 0.0 if math.isinf(material.nu) else material.nu, lambda value: float(value) or None),
        control("n", "n refractive index", Slider(1.0, 3.0, 0.01), lambda: material.n, float),
        control("body_colour", "body colour", Colour(), lambda: rgb_of_body(material.body_colour), body_of_rgb),
    ]  # fmt: skip


def rgb_of_body(body: Spectrum) -> tuple[int, int, int]:
    """Display values of a body colour under D65."""
    red, green, blue = srgb_encode(_linear_of_body(body)).tolist()
    return red, green, blue


def body_of_rgb(rgb: Sequence[int]) -> dict[str, list[float]]:
    """The record of a smooth body colour that has these display values under D65.

    It is a sum of the bands of `smooth_rgb_basis`; of a colour too strong for them, the nearest without a band below 0.
    """
    bands = [band.held(360.0, 830.0) for band in smooth_rgb_basis()]
    shares = np.linalg.solve(np.stack([_linear_of_body(band) for band in bands], axis=1), srgb_decode(np.array(rgb)))
    values = sum(share * band.values for share, band in zip(np.maximum(shares, 0.0), bands, strict=True))
    return Spectrum(bands[0].wavelengths, values).record()


def _linear_of_body(body: Spectrum) -> NDArray[np.float64]:
    """Linear sRGB of a body colour under D65, which is white."""
    observer, day = Response.load("cie1931"), Spectrum.named("D65")
    return srgb_from_xyz(camera_response(body, day, observer) / camera_white(day, observer) * WHITE_XYZ)
