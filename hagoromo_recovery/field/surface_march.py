"""Surface march: the law of matter that is a surface, the zero of a signed distance.

Opacity is that of elements that face the ray: σ = (1/s) (1 − Φ(d/s)) max(0, −∇d·v), Φ the logistic function of
width s. Along a piece of a ray in which d falls from d₀ to d₁ its optical depth is ln Φ(d₀/s) − ln Φ(d₁/s), whatever
lies between (Wang et al. 2021, NeuS); where d rises nothing is in the way, so light that leaves a surface, to a lamp
or to the eye, is not shaded by the skin that it comes from.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr

from hagoromo.backend import Array3f, Float, clip
from hagoromo_recovery.field.matter_march import MatterMarch, Piece

if TYPE_CHECKING:
    from hagoromo_recovery.field.distance_field import DistanceField

FAR = 6.0  # of s: beyond this distance nothing is opaque
LEAST_STEP, LARGEST_STEP = 1.4, 64.0  # [voxel]
STEP_SHARE = 0.9  # of the distance, that a step goes: the distance is not exact


def softplus(x: Float) -> Float:
    """ln(1 + exp x)."""
    return dr.fmax(x, 0.0) + dr.log(1.0 + dr.exp(-dr.abs(x)))


def depth_between(first: Float, second: Float, inverse: Float) -> Float:
    """Optical depth of a piece between two distances [voxel]; inverse: 1/s."""
    return dr.fmax(softplus(-second * inverse) - softplus(-first * inverse), 0.0)


def sigmoid(x: Float) -> Float:
    """Φ(x)."""
    return dr.rcp(1.0 + dr.exp(-x))


def share_of(first: Float, second: Float, inverse: Float) -> Float:
    """Where in a piece its light comes from on the mean, 0 at its begin to 1: d is taken to be linear in it.

    The light of a place of distance u has the weight Φ'(u/s), the logistic density: its mean is closed.
    """
    a, b = first * inverse, second * inverse

    def moment(x: Float) -> Float:
        return x * sigmoid(x) - softplus(x)

    total = sigmoid(a) - sigmoid(b)
    safe = dr.fmax(total, 1e-6)
    mean = dr.select(total > 1e-5, (moment(a) - moment(b)) / safe, 0.5 * (a + b))
    return clip((a - mean) / dr.fmax(a - b, 1e-6), 0.0, 1.0)


def step_length(distance: Float, inverse: Float) -> Float:
    """How far a ray may go from a place of this distance [voxel]."""
    free = STEP_SHARE * (dr.abs(distance) - FAR / inverse)
    return clip(free, LEAST_STEP, LARGEST_STEP)


class SurfaceMarch(MatterMarch):
    """field: signed distances. inverse: 1/s [1/voxel], Float. shading: see `NodeShading`."""

    def __init__(self, field: DistanceField, inverse: Float, shading: Any) -> None:
        super().__init__(field, shading)
        self.inverse = inverse

    def step_length(self, value: Float, place: Array3f) -> Float:
        """By the distance, `value`."""
        return step_length(value, self.inverse)

    def depth_of(self, piece: Piece) -> Float:
        """Where the distance falls."""
        return depth_between(piece.first, piece.second, self.inverse)

    def share_of(self, piece: Piece) -> Float:
        """The mean of a logistic density."""
        return share_of(piece.first, piece.second, self.inverse)
