"""Own light: the light that a solved surface receives from itself (interreflection), and photographs without it.

Enters: a capture with its solved normals, points and body colours. Leaves: per photograph and pixel the value that the
object's own light adds, α c_b E, with E from the values themselves (`exchange`): all bounces of light between what
the camera sees are in them. A cavity that lights itself looks flatter and brighter than it is; so solving, and
subtracting what follows from the solution, are repeated (Nayar, Ikeuchi & Kanade 1991).

Body colours are those of the object only if lamps and photographs have one unit. In the shadow of the object itself its
own light is alone, and the ratio of what is there to what is expected gives that unit: unless light of the room, which
is in all photographs, is there, too. Both are fitted; nothing separates them where that leaves the unit open.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import predicted
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.surface.depth import DepthSurface
from hagoromo.measurement.surface.exchange import Exchange, exchange
from hagoromo.measurement.surface.shadow_light import GLARE, OWN, ROOM, ShadowLight, shadow_light
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph

Values = NDArray[np.floating]
LARGEST_UNIT_ERROR = 0.25  # relative, of the unit, for it to count as measured
NOTABLE = 0.02  # share of the light: with less, nothing is said and nothing is subtracted
LARGE_SHARE = 99.0  # percentile of the pixels that "up to" means
LIT = 0.25  # of the median value of a photograph: darker pixels are in shadow
WHITEST = 1.05  # largest albedo of a body: above, lamps and photographs have different units


class Unit(NamedTuple):
    """Ratio of the light found in shadows to the own light expected there, and its standard error.

    room, room_error: light that is the same in all photographs [irradiance]. separate: whether the two can be taken
    apart; else the ratio is that without light of the room.
    """

    value: float = 1.0
    error: float = np.inf
    room: float = 0.0
    room_error: float = np.inf
    separate: bool = False


@dataclass(frozen=True, eq=False)
class OwnLight:
    """share: (h, w) of the light of each pixel, all photographs together, that comes from the object; most: (h, w) the
    largest over the photographs that light it. Both are 0 where unknown.

    unit: ratio of the light found in shadows to the light expected there, and its standard error; 1 and inf where no
    shadow shows it. albedo: of the body, in its brightest channel and in that unit. subtracted: whether normals and
    body colours are without it. room: share of the light that is the same in all photographs, and its standard error,
    where `separate`, that is where light of the room can be separated from the object's own. shadows: what the light in
    the shadows is, in words; it is not part of the record.
    """

    share: NDArray[np.float32]
    most: NDArray[np.float32]
    unit: float
    unit_error: float
    albedo: float = 0.0
    subtracted: bool = False
    room: float = 0.0
    room_error: float = np.inf
    separate: bool = False
    shadows: str = ""

    @property
    def known(self) -> bool:
        """Whether the unit was measured."""
        return self.unit_error < LARGEST_UNIT_ERROR * self.unit

    @property
    def possible(self) -> bool:
        """Whether a body can be that bright."""
        return self.albedo <= WHITEST

    @property
    def up_to(self) -> float:
        """Share of the light in the pixels that receive most of it."""
        pixels = self.share[self.share > 0.0]
        return float(np.percentile(pixels, LARGE_SHARE)) if len(pixels) else 0.0

    def record(self) -> dict[str, Any]:
        """The entry `own_light` of own_light.json."""
        pixels = self.share[self.share > 0.0]
        return {
            "up_to": self.up_to,
            "mean": float(pixels.mean()) if len(pixels) else 0.0,
            "unit": {"value": self.unit, "standard_error": self.unit_error if np.isfinite(self.unit_error) else None},
            "albedo": self.albedo,
            "subtracted": self.subtracted,
            "light_of_the_room": {
                "value": self.room if self.separate else None,
                "standard_error": self.room_error if self.separate else None,
                "separate": self.separate,
            },
        }

    def undetermined(self) -> str | None:
        """What these photographs leave open of the own light, why, and which would not; None where that is little."""
        if self.up_to < NOTABLE or self.separate:
            return None
        why = (
            "in the shadows light of the room, which is in all photographs, would look the same"
            if self.known
            else "no shadow of the object on itself shows how strong it is"
        )
        return (
            f"How much of the light the object sends to itself is not determined by these photographs: {why}. "
            "A photograph that would: one with all lamps off, or a lamp so low that the object shades itself."
        )

    def remark(self, here: NDArray[np.bool_]) -> str | None:
        """One line about the pixels `here` (h, w); None where little of their light is the object's own."""
        pixels = self.share[here & (self.share > 0.0)]
        if not len(pixels) or np.percentile(pixels, LARGE_SHARE) < NOTABLE:
            return None
        share = 100.0 * float(np.percentile(pixels, LARGE_SHARE))
        text = (
            f"up to {share:.0f} % of the light in its pixels comes from the object itself ({100 * pixels.mean():.1f} % "
        )
        text += "in the mean)"
        if self.subtracted:
            shown = f"the strength that shadows show, {self.unit:.2g} ± {self.unit_error:.1g}"
            return (
                f"{text}: it was subtracted, in {shown if self.known else 'the unit of the lamps, which is not tested'}"
            )
        if self.known and self.possible:
            shown = f"shadows show its strength, {self.unit:.2g} ± {self.unit_error:.1g} of what the lamps' unit gives"
            return (
                f"{text}: {shown}{self._room()}; it was not subtracted (--own-light subtract does), see own_light.exr"
            )
        why = (
            "no shadow shows how strong it is"
            if not self.known
            else "shadows hold more light than it can be, as light of the room"
        )
        return f"{text} if lamps and photographs have one unit: {why}; it was not subtracted, see own_light.exr"

    def _room(self) -> str:
        """What of the light may be, or is, that of the room."""
        if not self.separate:
            return "; or it is light of the room, which cannot be separated from it here"
        if self.room < 2.0 * self.room_error:
            return ", and no light of the room"
        return f", beside light of the room, {100 * self.room:.1f} ± {100 * self.room_error:.1g} % of all"


def own_light(capture: Capture, normal_map: NormalMap, surface: DepthSurface) -> tuple[OwnLight, list[Values]]:
    """The own light in `capture` of a surface solved from it, and what it adds to each photograph (h, w, C)."""
    net, parts = exchange(surface.points, normal_map.normals, capture.photographs[0].camera), []
    for photograph, interface in zip(capture.photographs, _interfaces(normal_map), strict=True):
        parts.append(_added(photograph, net, normal_map, interface))
    shadows = shadow_light(capture, normal_map, parts)
    unit = _unit(shadows)
    factor = unit.value if unit.error < LARGEST_UNIT_ERROR * unit.value else 1.0
    parts = [np.float32(factor) * part for part in parts]
    whitest = float(np.pi * factor * np.median(normal_map.fit.body.max(axis=0)))
    total, own, most = np.zeros(net.known.shape), np.zeros(net.known.shape), np.zeros(net.known.shape)
    for photograph, part in zip(capture.photographs, parts, strict=True):
        value = np.where(photograph.mask, photograph.values.mean(axis=2), 0.0)
        grey = np.where(photograph.mask, part.mean(axis=2), 0.0)
        lit = value > LIT * np.median(value[net.known])
        most = np.maximum(most, np.where(lit, grey / np.maximum(value, 1e-30), 0.0))
        total, own = total + np.maximum(value, 0.0), own + grey
    share = np.where(net.known & (total > 0.0), own / np.maximum(total, 1e-30), 0.0)
    most = np.where(net.known, most, 0.0)
    steady = (
        len(parts) * float(normal_map.body.mean(axis=2)[net.known].sum()) / max(float(total[net.known].sum()), 1e-30)
    )
    found = OwnLight(
        share.astype(np.float32), most.astype(np.float32), unit.value, unit.error, whitest,
        room=unit.room * steady, room_error=unit.room_error * steady, separate=unit.separate, shadows=shadows.sentence,
    )  # fmt: skip
    return found, parts


def without(capture: Capture, parts: list[Values]) -> Capture:
    """`capture` with photographs from which `parts` (h, w, C) are taken away."""
    photographs = [
        replace(photograph, values=(photograph.values - part).astype(photograph.values.dtype))
        for photograph, part in zip(capture.photographs, parts, strict=True)
    ]
    return replace(capture, photographs=tuple(photographs))


def _interfaces(normal_map: NormalMap) -> Iterator[Array]:
    """Of each photograph the interface (h, w, C), which goes one way and not to all sides."""
    fit, views = normal_map.fit, normal_map.views
    even, bare = fit.evenness(views.place), replace(fit, body=np.zeros_like(fit.body))
    for k in range(len(views.values)):
        value = predicted(bare, views.to_lamp[k : k + 1], views.to_eye)[0] * even[k] * views.light[k]
        yield views.image(value.T)


def _added(photograph: Photograph, net: Exchange, normal_map: NormalMap, interface: Array) -> Values:
    """(h, w, C) value that the light of the object adds to a photograph, for photographs in the unit of the lamps."""
    values = np.where(np.isfinite(photograph.values), photograph.values, 0.0)
    leaving = net.patches(np.maximum(values - interface, 0.0))
    return normal_map.body * net.pixels(net.matrix @ leaving).astype(np.float32)


def _unit(shadows: ShadowLight) -> Unit:
    """The unit by shadows that the object throws on itself; veiling glare is taken out where there is some."""
    beside = [GLARE] if shadows.glares else []
    alone, both = (shadows.solved([*sources, *beside]) for sources in ([OWN], [OWN, ROOM]))
    if both is not None:
        (own, room), (error, room_error) = both.strength[:2].tolist(), both.error[:2].tolist()
        if error < LARGEST_UNIT_ERROR * own:
            return Unit(own, error, room, room_error, separate=True)
    return Unit() if alone is None else Unit(float(alone.strength[0]), float(alone.error[0]))
