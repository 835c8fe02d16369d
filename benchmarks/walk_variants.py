"""Does the solved field make random walks more efficient? As control variate, for roulette, and for directions.

All variants walk the same scene at one wavelength, in turns, each with its own seed in every round. They have the same
expected value, but for control, whose field has highlights narrower than 0.2 rad widened:

* plain: as mode path walks.
* control: each event adds the light ∫ f L dω of the field L that it sends on, and takes away what the field brings
  along the direction that is drawn: walks estimate what the field is wrong by.
* roulette: a walk goes on with the chance of its throughput times the field's light ahead, over AIM times the mean
  light of the picture, LEAST at least; what survives counts more.
* directions: with the chance MIXED a direction is drawn by the field's mean light and its gradient, and else by the
  element; both count by the balance heuristic, where f over the albedo stands for the density of the element's draws.

Efficiency is 1/(variance × CPU time), over that of plain; the field's own solution comes on top. Leaves:
out/bench/walk_variants.json.

    python benchmarks/walk_variants.py [--scene linen] [--pixels 96] [--walks 32] [--rounds 3]
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from orders_scenes import CONTESTS, WAVELENGTH
from turns import options, record

import hagoromo as hg
from hagoromo.backend import Array3f, Bool, Float, UInt, arrays
from hagoromo.image.full.picture import light_of
from hagoromo.image.path.picture import ALL_ORDERS, walks_of
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache
from hagoromo.transport.field.field import Field
from hagoromo.transport.field.second_order import second_order
from hagoromo.transport.path.bands import Bands
from hagoromo.transport.path.path import FAINT, Event, five_of, random_numbers
from hagoromo.transport.path.scatter import frame_about
from hagoromo.transport.sample import Element
from studies.orders import SUBJECTS, box_of, scene_of

RECIPES = Path("examples/recipes")
VARIANTS = "plain", "control", "roulette", "directions"
AIM, LEAST, MIXED = 0.5, 0.1, 0.4


class Guided:
    """A scene's walks and its solved field, of one band and one group of lamps."""

    def __init__(self, scene: hg.Scene) -> None:
        bands = Bands(np.array([WAVELENGTH]), 0.0)
        self.prepared, self.scene = PreparedScene(scene, hg.Settings()), scene
        begin = time.process_time()
        field, _ = light_of(scene, self.prepared, hg.Settings(), bands, SceneCache())
        self.solving = time.process_time() - begin
        assert isinstance(field, Field)
        self.field, self.walks = field, walks_of(scene, self.prepared, bands)
        self.mean = dr.opaque(arrays().Float, 1.0)

    def sent(self, event: Event, to_eye: Array3f) -> Float:
        """∫ f L dω of the field at an event."""
        element = [Element(event.axis, event.material)]
        return self.field.scattered(event.point, to_eye, element, [event.coefficients])[0]

    def ahead(self, point: Array3f, direction: Array3f) -> Float:
        """The field's light from a direction, below 0 where nine numbers say so."""
        return second_order(self.field.incident(point)[0]).at(direction)

    def redrawn(
        self, event: Event, direction: Array3f, to_eye: Array3f, weight: Float, good: Bool, numbers: list[Float]
    ) -> tuple[Array3f, Float, Bool]:
        """Direction and weight of the mixture, from those that the element drew."""
        choice, u, v = numbers
        s, x, y, z, *_ = self.field.incident(event.point)[0]
        towards, length = arrays().Array3f(x, y, z), dr.sqrt(x * x + y * y + z * z)
        slope = dr.fmin(length / dr.fmax(s, 1e-30), 0.99)
        # density (1 + slope cosθ) / 4π about the gradient, inverted
        root = dr.sqrt(dr.fmax(1.0 - slope * (2.0 - slope - 4.0 * u), 0.0))
        cosine = dr.select(slope > 1e-3, (root - 1.0) / dr.fmax(slope, 1e-3), 2.0 * u - 1.0)
        one, other, middle = frame_about(towards / dr.fmax(length, 1e-30))
        sine, (a, b) = dr.sqrt(dr.fmax(1.0 - cosine * cosine, 0.0)), dr.sincos(2.0 * math.pi * v)[::-1]
        guided = sine * a * one + sine * b * other + cosine * middle
        by_field = choice < MIXED
        chosen = dr.select(by_field, guided, direction)
        of_field = (1.0 + slope * dr.dot(middle, chosen)) / (4.0 * math.pi)
        weights = self.walks.lighting.materials.weights(event.material, event.axis, chosen, to_eye)
        f = self.walks.mixed(event.coefficients, weights)[0]
        albedo = self.walks.mixed(
            event.coefficients, [math.pi * self.walks.lighting.materials.read(event.material, "alpha")] * 4
        )
        of_element = f / dr.fmax(albedo[0], 1e-3)
        share = MIXED * of_field / dr.fmax(MIXED * of_field + (1.0 - MIXED) * of_element, 1e-30)
        weight = dr.select(
            by_field, share * f / (MIXED * of_field), dr.select(good, (1.0 - share) * weight / (1.0 - MIXED), 0.0)
        )
        return dr.normalize(chosen), weight, weight > 0.0


@dr.syntax
def light(guided: Guided, variant: str, origin: Array3f, direction: Array3f, random: Any) -> Float:
    """Radiance by one walk along each ray."""
    jit, count, walks = arrays(), dr.width(direction), guided.walks
    total, carried, events = dr.zeros(jit.Float, count), dr.full(jit.Float, 1.0, count), dr.zeros(jit.UInt, count)
    alive, most = dr.full(jit.Bool, True, count), dr.opaque(jit.UInt, ALL_ORDERS)
    while alive:
        event, random = walks.event(origin, direction, random)
        to_eye = -direction
        _, weights, random = walks.lamp(event, to_eye, random)
        total = dr.fma(carried, walks.mixed(event.coefficients, weights)[0], total)
        direction, sent, good = walks.scattering.drawn(event.material, event.axis, to_eye, five_of(random))
        weight = walks.mixed(event.coefficients, list(sent))[0]
        good &= event.there
        if dr.hint(variant == "directions", mode="scalar"):
            three = three_of(random)
            direction, weight, good = guided.redrawn(event, direction, to_eye, weight, good, three)
            good &= event.there
        if dr.hint(variant == "control", mode="scalar"):
            own, there = guided.sent(event, to_eye), guided.ahead(event.point, direction)
            total += dr.select(event.there, carried * (own - dr.select(good, weight * there, 0.0)), 0.0)
        carried *= dr.select(good, weight, 0.0)
        events += 1
        stays = dr.fmin(carried * (1.0 / FAINT), 1.0)
        if dr.hint(variant == "roulette", mode="scalar"):
            ahead = carried * dr.fmax(guided.ahead(event.point, direction), 0.0)
            stays = dr.fmin(dr.fmax(ahead / (AIM * guided.mean), LEAST * dr.fmin(carried, 1.0)), 1.0)
        alive = good & (random.next_float32() < stays) & (events < most)
        carried /= dr.fmax(stays, 1e-30)
        origin = event.point
    return total


def three_of(random: Any) -> list[Float]:
    """Three random numbers."""
    return [random.next_float32() for _ in range(3)]


def picture(guided: Guided, variant: str, walks: int, seed: int) -> tuple[float, float, float]:
    """Mean light of the pixels, the variance of one walk in a pixel, and CPU time [s]."""
    jit, camera = arrays(), guided.prepared.camera
    pixels = camera.width * camera.height
    begin = time.process_time()
    lane = dr.arange(jit.UInt, pixels * walks)
    each, width = dr.opaque(jit.UInt, walks), dr.opaque(jit.UInt, camera.width)
    pixel: UInt = lane // each
    random = random_numbers(pixel, lane % each, seed)
    x, y = jit.Float(pixel % width) + random.next_float32(), jit.Float(pixel // width) + random.next_float32()
    origin, direction = camera.rays(x, y, guided.prepared.ahead)
    values = np.array(light(guided, variant, origin, direction, random), float).reshape(pixels, walks)
    taken = time.process_time() - begin
    return float(values.mean()), float(values.var(axis=1, ddof=1).mean()), taken


def scenes(pixels: int) -> dict[str, Callable[[], hg.Scene]]:
    """Linen from both sides and skin of the study of orders, and the head of white hair."""

    def of_study(name: str) -> Callable[[], hg.Scene]:
        return lambda: scene_of(box_of(RECIPES, SUBJECTS[name]), SUBJECTS[name], pixels)

    found = {name: of_study(name) for name in ("linen", "backlit", "skin")}
    return found | {"hair": lambda: CONTESTS["hair"]().scene(pixels)}


def measured(guided: Guided, walks: int, rounds: int) -> list[dict[str, Any]]:
    """A row for each variant."""
    found: dict[str, list[tuple[float, float, float]]] = {variant: [] for variant in VARIANTS}
    for variant in VARIANTS:
        mean, _, _ = picture(guided, variant, 2, 90)  # compiles
        if variant == "plain":
            guided.mean = dr.opaque(arrays().Float, mean)
    for seed in range(1, rounds + 1):
        for variant in VARIANTS:
            found[variant].append(picture(guided, variant, walks, seed))
    rows: list[dict[str, Any]] = []
    for variant, values in found.items():
        mean, variance, taken = (float(np.median([value[k] for value in values])) for k in range(3))
        rows.append({"variant": variant, "mean": mean, "variance": variance, "cpu_s": taken})
    plain = rows[0]
    for row in rows:
        row["efficiency"] = plain["variance"] * plain["cpu_s"] / (row["variance"] * row["cpu_s"])
    return rows


def main() -> None:
    """Measure the scenes that are asked for."""
    parser = options(__doc__, 3)
    parser.add_argument("--scene", choices=("linen", "backlit", "skin", "hair"), action="append")
    parser.add_argument("--pixels", type=int, default=96)
    parser.add_argument("--walks", type=int, default=32)
    given = parser.parse_args()
    figures: dict[str, Any] = {"pixels": given.pixels, "walks": given.walks, "rounds": given.rounds, "scenes": {}}
    for name, scene in scenes(given.pixels).items():
        if given.scene and name not in given.scene:
            continue
        guided = Guided(scene())
        rows = measured(guided, given.walks, given.rounds)
        figures["scenes"][name] = {"solving_s": guided.solving, "rows": rows}
        print(f"{name}: field {guided.solving:.1f} CPU s", flush=True)
        for row in rows:
            print("   ", row, flush=True)
    record("walk_variants", figures)


if __name__ == "__main__":
    main()
