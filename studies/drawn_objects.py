"""Objects and captures drawn at random for `recover`: form, colours, gloss, cameras, lamps and sensor from one number.

A number always draws the same. Nothing in it is chosen to be easy: matter may be thin, black, white or a mirror,
cameras may stand on one side alone, photographs may be few and dark, and poses a little wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.matter import shape as sd
from studies.recover_scenes import (
    ALPHA,
    DISTANCE,
    Shots,
    Simulated,
    TrueObject,
    TrueSensor,
    around,
    misstated,
    near_lamp,
    simulated,
)

Array = NDArray[np.float64]
Draw = np.random.Generator
Form = Callable[[Any], Any]  # signed distance [m] of points [m]
FIVE = around(5, turn=0.2)  # directions of lamps that stand still
PIXELS, ASIDE = 96, 4  # of photographs, a side; photographs kept aside
BODY_AT = (380.0, 500.0, 600.0, 730.0)  # nm
LESS = 0.95  # of the body colours of an object that gives back more than it takes, in each try
SENSORS = (TrueSensor(20_000.0, 8.0, 12), TrueSensor(60_000.0, 4.0, 16), TrueSensor(8_000.0, 8.0, 8))
GLOSSES = (0.0, 0.0, 0.2, 0.6, 1.5, 4.0)  # β
WIDTHS = {0.0: (0.1,), 0.2: (0.2, 0.4), 0.6: (0.1, 0.2, 0.3), 1.5: (0.07, 0.1, 0.15), 4.0: (0.05, 0.08)}  # γ by β


class DrawnObject(TrueObject):
    """An object of a form, with body colours `base` + `swing` times a pattern of a wavelength [m]."""

    def __init__(self, form: Form, base: Array, swing: Array, wave: float, gloss: tuple[float, float, float]) -> None:
        super().__init__(*gloss)
        self.form, self.base, self.swing, self.wave = form, base, swing, wave

    def distance(self, p: Any) -> Any:
        """Signed distance [m]."""
        return self.form(p)

    def colours(self, p: Any) -> list[Any]:
        """Body colour at points."""
        k, found = 2.0 * np.pi / self.wave, []
        for c, (base, swing) in enumerate(zip(self.base, self.swing, strict=True)):
            at = (p.x, p.y, p.z)
            pattern = dr.sin(k * at[c] + 1.3 * c) * dr.cos(0.7 * k * at[(c + 1) % 3])
            found.append(float(base) + float(swing) * pattern)
        return found


class DrawnCapture(NamedTuple):
    """taken: photographs. aside: exact ones of new views under new lamps. words: for what was drawn."""

    truth: DrawnObject
    taken: Simulated
    aside: Simulated
    words: str


def drawn_capture(number: int) -> DrawnCapture:
    """The object and the capture of a number."""
    draw = np.random.default_rng([number, 0x0B1EC7])
    truth, object_words = drawn_object(draw)
    given, aside, rig_words = drawn_rig(draw)
    sensor = SENSORS[int(draw.integers(len(SENSORS)))]
    taken = simulated(truth, given, number, sensor=sensor)
    exact = simulated(truth, aside, number, noise=False)
    words = [object_words, rig_words, f"{sensor.bits} bits"]
    if draw.random() < 0.3:
        wrong = float(draw.choice([0.3, 1.0]))
        taken = misstated(taken, wrong, 0.0, number)
        words.append(f"poses {wrong:g} px wrong")
    if draw.random() < 0.3:
        taken = without_masks(taken)
        words.append("no masks")
    return DrawnCapture(truth, taken, exact, "; ".join(words))


def without_masks(taken: Simulated) -> Simulated:
    """The same photographs, before their dark background, without masks."""
    photographs = tuple(
        replace(p, silhouette=None, mask=p.mask | ~p.silhouette)
        for p in taken.capture.photographs
        if p.silhouette is not None
    )
    return replace(taken, capture=replace(taken.capture, photographs=photographs))


def torus(draw: Draw) -> Form:
    """A ring, thick or thin."""
    thick = float(draw.uniform(0.006, 0.016))

    def distance(p: Any) -> Any:
        ring = dr.sqrt(p.x * p.x + p.y * p.y) - (0.042 - thick)
        return dr.sqrt(ring * ring + p.z * p.z) - thick

    return distance


def ball_with_bumps(draw: Draw) -> Form:
    """A ball with hills and dales of one width."""
    high, k = float(draw.uniform(0.001, 0.003)), float(draw.uniform(150.0, 350.0))
    steep = np.sqrt(1.0 + (high * k) ** 2)

    def distance(p: Any) -> Any:
        return (dr.norm(p) - 0.034 - high * dr.sin(k * p.x) * dr.sin(k * p.y) * dr.sin(k * p.z)) / steep

    return distance


def block(draw: Draw) -> Form:
    """A block, its edges sharp or round."""
    half, edge = tuple(draw.uniform(0.014, 0.03, 3).tolist()), float(draw.choice([0.0005, 0.003, 0.008]))
    return lambda p: sd.rounded_box(p, (0.0, 0.0, 0.0), half, edge)


def plate(draw: Draw) -> Form:
    """A plate of 2 to 8 mm."""
    half = 0.04, 0.03, float(draw.uniform(0.001, 0.004))
    return lambda p: sd.rounded_box(p, (0.0, 0.0, 0.0), half, 0.0008)


def cup(draw: Draw) -> Form:
    """A round cup, open at one end."""
    wall, deep = float(draw.uniform(0.003, 0.008)), float(draw.uniform(0.01, 0.05))

    def distance(p: Any) -> Any:
        outside = sd.capsule(p, (0.0, 0.0, -0.012), (0.0, 0.0, 0.012), 0.027)
        bore = sd.capsule(p, (0.0, 0.0, 0.03 - deep), (0.0, 0.0, 0.08), 0.027 - wall)
        return sd.smooth_difference(dr.fmax(outside, p.z - 0.025), bore, 0.002)

    return distance


def two_bodies(draw: Draw) -> Form:
    """Two balls that touch each other, stand apart, or blend."""
    small, apart = float(draw.uniform(0.008, 0.02)), float(draw.choice([-0.004, 0.0, 0.006]))
    large = 0.022
    at = large + small + apart

    def distance(p: Any) -> Any:
        other = sd.sphere(p, (at - 0.014, 0.0, 0.0), small)
        return dr.fmin(sd.sphere(p, (-0.014, 0.0, 0.0), large), other)

    return distance


def ball(draw: Draw) -> Form:
    """A ball, or an ellipsoid."""
    radii = tuple(draw.uniform(0.018, 0.038, 3).tolist()) if draw.random() < 0.5 else (0.03, 0.03, 0.03)
    return lambda p: 0.6 * sd.ellipsoid(p, (0.0, 0.0, 0.0), radii)


def cross(draw: Draw) -> Form:
    """Three bars that cross each other."""
    thick = float(draw.uniform(0.004, 0.009))
    ends = [tuple(0.036 * d) for d in np.linalg.qr(draw.normal(size=(3, 3)))[0]]

    def distance(p: Any) -> Any:
        bars = [sd.capsule(p, tuple(-np.array(end)), end, thick) for end in ends]
        return sd.smooth_union(sd.smooth_union(bars[0], bars[1], 0.004), bars[2], 0.004)

    return distance


FORMS: dict[str, Callable[[Draw], Form]] = {
    "ball": ball, "ring": torus, "ball with bumps": ball_with_bumps, "block": block, "plate": plate, "cup": cup,
    "two bodies": two_bodies, "cross": cross,
}  # fmt: skip


def drawn_object(draw: Draw) -> tuple[DrawnObject, str]:
    """An object, and words for it."""
    name = str(draw.choice(list(FORMS)))
    form = FORMS[name](draw)
    centre, turn = tuple(draw.uniform(-0.006, 0.006, 3).tolist()), tuple(draw.uniform(0.0, 360.0, 3).tolist())
    size = float(draw.uniform(0.6, 1.0))

    def placed(p: Any) -> Any:
        return size * form(sd.placed(p, centre, turn) / size)

    beta = float(draw.choice(GLOSSES))
    gloss = beta, float(draw.choice(WIDTHS[beta])), float(draw.choice([1.4, 1.5, 1.7]))
    kind, base, swing = drawn_colours(draw)
    wave = float(draw.uniform(0.02, 0.06))
    while not conserves(gloss, float((base + swing).max())):
        base, swing = LESS * base, LESS * swing
    shine = "matt" if not beta else f"β {beta:g}, γ {gloss[1]:g}, n {gloss[2]:g}"
    return DrawnObject(placed, base, swing, wave, gloss), f"{name}, {kind}, {shine}"


def drawn_colours(draw: Draw) -> tuple[str, Array, Array]:
    """A kind of body colours, their means and how far they swing."""
    kind = str(draw.choice(["pattern", "pattern", "flat", "white", "dark", "strong colour"]))
    if kind == "white":
        return kind, np.full(3, 0.85), np.zeros(3)
    if kind == "dark":
        return kind, draw.uniform(0.02, 0.06, 3), np.full(3, 0.01)
    if kind == "strong colour":
        return kind, draw.permutation([0.6, 0.2, 0.04]), np.array([0.02, 0.02, 0.02])
    base = draw.uniform(0.2, 0.6, 3)
    return kind, base, np.zeros(3) if kind == "flat" else 0.45 * base


def conserves(gloss: tuple[float, float, float], colour: float) -> bool:
    """Whether an object of this gloss and body colour gives back no more than it takes."""
    try:
        hg.Reflectance(
            alpha=ALPHA, beta=gloss[0], gamma=gloss[1], n=gloss[2], body_colour=hg.Spectrum(BODY_AT, np.full(4, colour))
        )
    except hg.InputError:
        return False
    return True


def drawn_rig(draw: Draw) -> tuple[Shots, Shots, str]:
    """Cameras and lamps of the photographs, and of those kept aside, and words for them."""
    place = str(draw.choice(["all around", "all around", "from above", "in a ring", "in front"]))
    light = str(
        draw.choice(["near lamp", "near lamp", "wide near lamp", "far lamp", "flash at the camera", "five lamps"])
    )
    count, each = int(draw.choice([8, 12, 20])), int(draw.choice([1, 1, 3]))
    each = 1 if light == "flash at the camera" else each
    low, high = (5.0, 100.0) if light == "wide near lamp" else (5.0, 60.0)

    def shots(many: int, lamps: int, seed: int) -> Shots:
        random = np.random.default_rng(seed)
        views, of_views = placed_views(place, many, 0.7 * seed), []
        for view in views:
            if light == "flash at the camera":
                of_views.append((DISTANCE * view)[None])
            elif light == "five lamps":
                lit = FIVE[FIVE @ view > 0.1]
                chosen = random.permutation(len(lit))[:lamps]
                of_views.append(0.5 * lit[chosen])
            else:
                of_views.append(np.stack([near_lamp(view, low, high, random) for _ in range(lamps)]))
        return Shots(views, of_views, PIXELS, far=light == "far lamp")

    seed = int(draw.integers(1, 1000))
    words = f"{count} views {place}, {each} × {light}"
    return shots(count, each, seed), shots(ASIDE, 1, seed + 1), words


def placed_views(place: str, count: int, turn: float) -> Array:
    """Directions (count, 3) of cameras."""
    if place == "all around":
        return around(count, turn=turn)
    if place == "in front":  # within 50° of an axis
        number = np.arange(count) + 0.5
        along, angle = 1.0 - (1.0 - np.cos(np.radians(50.0))) * number / count, np.pi * (3.0 - 5.0**0.5) * number + turn
        across = np.sqrt(1.0 - along**2)
        return np.stack([across * np.cos(angle), -along, across * np.sin(angle)], axis=1)
    angle = 2.0 * np.pi * np.arange(count) / count + turn
    if place == "in a ring":
        up = np.full(count, np.sin(np.radians(25.0)))
    else:
        up = np.sin(np.radians(np.where(np.arange(count) % 2, 20.0, 55.0)))
    across = np.sqrt(1.0 - up**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), up], axis=1)
