"""Shading: eq. (2)–(6) over all lamps and pixels at once, with derivatives by turns of the normal.

The body part is α cosθ_i of MODEL §2, times `body_factor` for a rough body (σ), which sends more light back towards the
lamp, so that the limb of a ball stays bright, and for other deviations from Lambert's law, such as scattering below the
surface, by an exponent (ε).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, column
from hagoromo.measurement.facets import log_density_by_tail
from hagoromo.measurement.parameters import contrasts
from hagoromo.reflectance.body import LEAST_COSINE, body_factor, retroreflection
from hagoromo.reflectance.torrance_sparrow import torrance_sparrow

Array = NDArray[np.float64]

N = 1.5  # refractive index: not identifiable when all lamps stand on the camera's side
SIGMA, EXPONENT = 2, 3  # places of σ and ln(1 + ε) in a row of gloss
TAIL = 4  # place of the tail in a row of gloss; the numbers of the interface colour follow it


@dataclass(frozen=True, eq=False)
class Gloss:
    """Deviation of M materials from Lambert: rows (ln β, ln γ, σ, ln(1 + ε), tail 1/ν, x), (M, 5 + C − 1).

    β is in the unit of the values, and that of the geometric mean of the C channels. The C − 1 numbers x give the
    colour of the interface (see `parameters`); 0 is a neutral one.
    """

    rows: Array

    @staticmethod
    def none(count: int, channels: int) -> Gloss:
        """Materials without an interface, whose body follows Lambert's law."""
        return Gloss.alike((-np.inf, np.log(0.3), 0.0, 0.0), count, channels)

    @staticmethod
    def alike(row: Sequence[float], count: int, channels: int) -> Gloss:
        """Materials of the same `row` (ln β, ln γ, σ, ln(1 + ε)), with Gaussian facets and a neutral interface."""
        return Gloss(np.tile([*row, *np.zeros(channels)], (count, 1)))

    @property
    def colour(self) -> Array:
        """(M, C) colour of the interface, of geometric mean 1."""
        return colour_of(self.rows)


def colour_of(rows: Array) -> Array:
    """(M, C) colour of the interface in rows of gloss (M, 5 + C − 1), of geometric mean 1."""
    return np.exp(rows[:, TAIL + 1 :] @ contrasts(rows.shape[1] - TAIL).T).astype(np.float64)


class Shading(NamedTuple):
    """Weights of body colour and interface, (K, P) each, and their slopes by the two turns of the normal [1/rad].

    by_width: slope of the interface by ln γ. by_body: slopes of the body by σ and ln(1 + ε). body_led, interface_led:
    slopes by turns of the lamp towards `tangents(to_lamp)`.
    """

    body: Array
    interface: Array
    body_turned: tuple[Array, Array]
    interface_turned: tuple[Array, Array]
    by_width: Array
    by_body: tuple[Array, Array]
    body_led: tuple[Array, Array]
    interface_led: tuple[Array, Array]


def shading(normals: Array, to_lamp: Array, to_eye: Array, gloss: Array) -> Shading:
    """Shading of pixels with `normals` (P, 3), under lamps to_lamp (K, P, 3), gloss (P, 4 or more) rows of `Gloss`.

    The turns are towards `tangents(normals)`. The interface is that of a channel of colour 1; rows of four numbers have
    Gaussian facets.
    """
    jit, (lamps, pixels) = arrays(), to_lamp.shape[:2]

    def wide(vectors: Array) -> Any:
        tiled = np.ascontiguousarray(np.tile(vectors, (lamps, 1)).T, np.float32)
        return jit.Array3f(tiled) if len(tiled) == 3 else [column(jit.Float, row) for row in tiled]

    n, v, (t, b) = wide(normals), wide(to_eye), (wide(turn) for turn in tangents(normals))
    towards = jit.Array3f(to_lamp.reshape(-1, 3).T.astype(np.float32))
    log_beta, log_gamma, *body_rows = wide(np.maximum(gloss[:, :TAIL], -80.0))
    nu = exponent_of(gloss)
    tails = {} if nu is None else {"nu": wide(nu[:, None])[0]}
    parts = []
    aside = [jit.Array3f(turn.T.astype(np.float32)) for turn in tangents(to_lamp.reshape(-1, 3))]
    still = jit.Array3f(0.0)
    for turned in range(5):
        moved = dr.zeros(jit.Float, lamps * pixels)
        dr.enable_grad(moved)
        # N + δ t, made unit: the angle is arctan δ, its slope 1 at δ = 0
        normal = dr.normalize(n + moved * (t, b, still, still, still)[turned])
        led = dr.normalize(towards + moved * (still, still, still, *aside)[turned])
        width = dr.exp(log_gamma + moved if turned == 2 else log_gamma)
        weights = torrance_sparrow(normal, led, v, 1.0, dr.exp(log_beta), width, N, **tails)
        body = body_of(weights.body, dr.dot(normal, v), dr.dot(led, v), body_rows)
        dr.set_grad(moved, 1.0)
        slopes = dr.forward_to(body, weights.interface)
        parts += [dr.detach(body), dr.detach(weights.interface), *slopes]
    view, phase = dr.dot(n, v), dr.dot(towards, v)
    lambert = dr.select(view > 0.0, dr.fmax(dr.dot(n, towards), 0.0), 0.0)
    slopes = body_slopes(lambert, view, phase, body_rows)
    # four of each turn: body, interface, and their slopes
    chosen = [parts[i] for i in (0, 1, 2, 6, 3, 7, 11, 14, 18, 15, 19)] + slopes
    dr.eval(chosen)
    body, interface, b1, b2, i1, i2, by_width, b3, b4, i3, i4, by_sigma, by_epsilon = (
        part.numpy().reshape(lamps, pixels).astype(np.float64) for part in chosen
    )
    return Shading(body, interface, (b1, b2), (i1, i2), by_width, (by_sigma, by_epsilon), (b3, b4), (i3, i4))


class Lit(NamedTuple):
    """Weights of body colour and interface, and slopes of the body by σ and ln(1 + ε), as `Shading` has them: flat
    arrays of the device, of K lamps in turn.
    """

    body: Any
    interface: Any
    by_body: tuple[Any, Any]


def lit(normals: Array, to_lamp: Array, to_eye: Array, gloss: Array, further: Sequence[Array] = ()) -> Lit:
    """As `shading`, without slopes by turns.

    further: of each further lobe (P, 2) ln β and ln γ [rad] of its Gaussian facets, whose light the interface has, too.
    """
    jit, (lamps, pixels) = arrays(), to_lamp.shape[:2]
    pixel = dr.arange(jit.UInt, lamps * pixels) % dr.opaque(jit.UInt, pixels)

    def wide(rows: Array) -> list[Any]:
        return [dr.gather(jit.Float, column(jit.Float, row.astype(np.float32)), pixel) for row in rows.T]

    normal, eye = dr.normalize(jit.Array3f(*wide(normals))), jit.Array3f(*wide(to_eye))
    lamp = jit.Array3f(*(column(jit.Float, to_lamp[..., i].astype(np.float32)) for i in range(3)))
    log_beta, log_gamma, *body_rows = wide(np.maximum(gloss[:, :TAIL], -80.0))
    nu = exponent_of(gloss)
    tails = {} if nu is None else {"nu": wide(nu[:, None])[0]}
    body, interface = torrance_sparrow(normal, lamp, eye, 1.0, dr.exp(log_beta), dr.exp(log_gamma), N, **tails)
    for lobe in further:
        beta, gamma = (dr.exp(row) for row in wide(np.maximum(lobe, -80.0)))
        interface = interface + torrance_sparrow(normal, lamp, eye, 1.0, beta, gamma, N).interface
    view, phase = dr.dot(normal, eye), dr.dot(lamp, eye)
    by_sigma, by_exponent = body_slopes(body, view, phase, body_rows)
    return Lit(body_of(body, view, phase, body_rows), interface, (by_sigma, by_exponent))


def lit_values(
    normals: Array, to_lamp: Array, to_eye: Array, gloss: Array, further: Sequence[Array] = ()
) -> tuple[Array, Array]:
    """(K, P) weights of body colour and interface of `lit`."""
    both = lit(normals, to_lamp, to_eye, gloss, further)[:2]
    dr.eval(*both)
    body, interface = (part.numpy().reshape(to_lamp.shape[:2]).astype(np.float64) for part in both)
    return body, interface


def exponent_of(gloss: Array) -> Array | None:
    """(P,) ν of rows of gloss, infinite for Gaussian facets; None where all are: then eq. (4) is computed."""
    tail = gloss[:, TAIL] if gloss.shape[1] > TAIL else np.zeros(1)
    return None if not np.any(tail > 0.0) else np.where(tail > 0.0, 1.0 / np.where(tail > 0.0, tail, 1.0), np.inf)


def interface_by_tail(interface: Array, normals: Array, to_lamp: Array, to_eye: Array, gloss: Array) -> Array:
    """Slope (K, P) of the `interface` of `shading` by the tail 1/ν."""
    half = to_lamp + to_eye
    cosine = np.einsum("kpi,pi->kp", half, normals) / np.maximum(np.linalg.norm(half, axis=2), 1e-12)
    u = np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2 * np.exp(-2.0 * gloss[:, 1])
    return interface * log_density_by_tail(u, np.broadcast_to(gloss[:, TAIL], u.shape))


def tangents(normals: Array) -> tuple[Array, Array]:
    """Two unit vectors (…, 3) each that make a right-handed frame with `normals` (…, 3)."""
    aside = np.where(np.abs(normals[..., :1]) < 0.6, [1.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    first = np.cross(aside, normals)
    first /= np.linalg.norm(first, axis=-1, keepdims=True)
    return first, np.cross(normals, first).astype(np.float64)


def turned(normals: Array, angles: Array, to_eye: Array) -> Array:
    """`normals` turned by `angles` (P, 2) [rad] towards their tangents, with a cosine to the eye of LEAST_COSINE."""
    first, second = tangents(normals)
    moved = normals + angles[:, :1] * first + angles[:, 1:] * second
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    short = np.maximum(LEAST_COSINE - np.einsum("pi,pi->p", moved, to_eye), 0.0)
    moved += short[:, None] * to_eye
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def body_of(lambert: Any, view: Any, phase: Any, rows: Sequence[Any]) -> Any:
    """The body part: cosθ_i, 0 where unlit, of Lambert's law → that of `rows` (σ, ln(1 + ε)); phase: L·V."""
    sigma, log_exponent = rows
    return lambert * body_factor(lambert, view, phase, dr.exp(log_exponent) - 1.0, sigma)


def body_slopes(lambert: Any, view: Any, phase: Any, rows: Sequence[Any]) -> list[Any]:
    """Slopes of `body_of` by σ and by ln(1 + ε)."""
    whole, exponent = body_of(lambert, view, phase, rows), dr.exp(rows[1])
    smooth = lambert * body_factor(lambert, view, phase, exponent - 1.0, 0.0)
    logarithm = dr.log(dr.fmax(lambert, LEAST_COSINE) * dr.fmax(view, LEAST_COSINE))
    return [smooth * retroreflection(lambert, view, phase), whole * exponent * logarithm]
