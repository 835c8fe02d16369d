"""NodeShading: what a place sends to the eye under the lamps of its photograph."""

from __future__ import annotations

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, arrays, clip, lookup
from hagoromo.reflectance.element import element_weights
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.shading.lamp_table import LampTable
from hagoromo_recovery.shading.unknown_light import UnknownLight

ALPHA = 1.0 / np.pi  # [1/sr]: body colours are then albedos
FADE = 0.1  # cosθ_r below which light fades to 0: a sudden end has no derivative (6°)
GLOSS = ("beta", "gamma", "n")  # what `NodeShading.gloss` holds, as ln β, ln γ, ln(n − 1)
TWO_GLOSSES = (*GLOSS, "beta", "gamma")  # of two, which have one n; a place has shares of both
START = (0.5, 0.25, 1.5)
NO_GLOSS = 1e-6  # β [1/sr] of a matt object: far below any that is fitted
APART = 2.5  # factor between the widths of two glosses at the start


def coordinates(beta: float, gamma: float, n: float) -> np.ndarray:
    """The numbers that descent moves."""
    return np.log([beta, gamma, n - 1.0])


def matt(gloss: np.ndarray) -> np.ndarray:
    """The numbers of no gloss, the others as they were."""
    return np.array([np.log(NO_GLOSS), *np.asarray(gloss, float)[1:]])


def is_matt(gloss: np.ndarray) -> bool:
    """Whether the numbers are those of no gloss."""
    return bool(gloss[0] < np.log(2.0 * NO_GLOSS))


def figures(gloss: np.ndarray) -> tuple[float, float, float]:
    """β [1/sr], γ [rad] and n of those numbers."""
    beta, gamma, n1 = np.exp(np.asarray(gloss, float)[: len(GLOSS)])
    return float(beta), float(gamma), float(1.0 + n1)


def two_glosses(gloss: np.ndarray) -> np.ndarray:
    """The numbers of two glosses, one narrower and one wider than another one."""
    beta, gamma, n = gloss
    half = 0.5 * np.log(APART)
    return np.array([beta, gamma - half, n, beta, gamma + half])


def order_of(gloss: np.ndarray) -> list[int]:
    """Which of these numbers come where, so that the narrower of two glosses is the first."""
    return [3, 4, 2, 0, 1] if len(gloss) > len(GLOSS) and gloss[1] > gloss[4] else list(range(len(gloss)))


def each_gloss(gloss: np.ndarray) -> list[list[int]]:
    """Where in these numbers ln β, ln γ and ln(n − 1) of each gloss stand."""
    return [[0, 1, 2]] if len(gloss) == len(GLOSS) else [[0, 1, 2], [3, 4, 2]]


class NodeShading:
    """Light of every lamp and colour, without shadows.

    lamps: those of all photographs. gloss: Float (3,), see `coordinates`, or (5,), that of two glosses:
    ln β and ln γ of the second stand behind. Without lamps body colours
    stand for the light that a place sends out, or for that over the irradiance of its normal under `unknown` light.
    element: "plane", whose axis is the normal, or "cylinder", whose axis is the tangent of fibres. photograph: number
    of that of every ray, set before each march. between: whether channels of light from other parts of the object stand
    behind those of the lamps: what a body sends back of an irradiance of 1.
    """

    def __init__(
        self, lamps: LampTable, gloss: np.ndarray, unknown: UnknownLight | None = None, element: str = "plane"
    ) -> None:
        self.lamps, self.unknown, self.element, self.photograph = lamps, unknown, element, arrays().UInt(0)
        self.between = False
        self.set_gloss(gloss)

    def set_gloss(self, gloss: np.ndarray) -> None:
        """Other numbers of the gloss."""
        self.gloss = lookup(arrays().Float, np.asarray(gloss, np.float32))
        self.glosses = each_gloss(gloss)

    @property
    def channels(self) -> int:
        """Numbers of what `__call__` gives."""
        return COLOURS * (max(self.lamps.each, 1) + self.between)

    def __call__(self, place: Array3f, axis: Array3f, to_eye: Array3f, looks: list[Float]) -> list[Float]:
        """Radiance of every lamp and channel. looks: see `MatterField.looks_at`."""
        colours, share = looks[:COLOURS], looks[COLOURS:]
        if not self.lamps.each:
            return self._unlit(axis, colours)
        jit, light = arrays(), []
        numbers = [[dr.exp(dr.gather(jit.Float, self.gloss, jit.UInt(k))) for k in one] for one in self.glosses]
        shares = [1.0 - share[0], share[0]] if share else [1.0]
        fade = faded(dr.dot(axis, to_eye)) if self.element == "plane" else 1.0  # fibres have no horizon
        for k in range(self.lamps.each):
            to_lamp, _, irradiance = self.lamps.arriving(self.photograph, k, place)
            parts = [
                element_weights(self.element, axis, to_lamp, to_eye, ALPHA, beta, gamma, 1.0 + n1)
                for beta, gamma, n1 in numbers
            ]
            sent = sum(share * part.interface for share, part in zip(shares, parts, strict=True))
            body, interface = parts[0].body * fade, sent * fade
            light += [irradiance[c] * dr.fma(body, colours[c], interface) for c in range(COLOURS)]
        if self.between:
            light += [ALPHA * fade * colour for colour in colours]
        return light

    def _unlit(self, normal: Array3f, colours: list[Float]) -> list[Float]:
        """Light of every channel where no lamp is known."""
        if self.unknown is None:
            return list(colours)
        irradiance = self.unknown.irradiance(self.photograph, normal)
        return [e * c for e, c in zip(irradiance, colours, strict=True)]


def faded(view: Float) -> Float:
    """Factor on light that falls to 0, without a sudden end, where cosθ_r = `view` does."""
    share = clip(view * (1.0 / FADE), 0.0, 1.0)
    return share * share * (3.0 - 2.0 * share)
