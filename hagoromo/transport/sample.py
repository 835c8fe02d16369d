"""Samples of a medium: the elements at a place, where their shadow rays begin, and the place in a texel."""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr

from hagoromo.backend import Array3f, Bool, Float, UInt
from hagoromo.transport.chart import SurfaceFrame, SurfacePoint
from hagoromo.volume.texel import LightScale

BIAS_TO_LAMP = 2.0  # of the shadow bias, towards the lamp; once more it goes along the axis
# of the shadow bias, across the way to the lamp, for shadows from afar: on average matter that casts them is half
# opaque so far before its visible surface
FAR_BIAS = 0.68
LEAST_ACROSS = 0.5  # sine of the angle between axis and lamp below which that offset is no longer reached
FAR_HEIGHT = 2.0  # of the shadow bias: height over a plane skin from which on shadows count as those from afar
LEAST_RISE = 0.02  # cosine to the lamp below which that height is not waited for


@dataclass
class Element:
    """A kind of element in a sample: unit axis (world), material number, share of the sample 0…1, and the scales of its
    body and interface light in a texel.

    shadow_bias: of an opaque skin, see `VolumeBox` [m]; None where no box has any. gamma: half width of the facets
    [rad], None: that of the material. across: of surfaces, from their front to their back where they let light through
    [m], 0 of others; None where none does. ground: of surfaces, see `SurfaceHit`. there: of which samples it is a part;
    None: of all.
    """

    axis: Array3f
    material: UInt
    share: Float = 1.0
    scales: LightScale | None = None
    shadow_bias: Float | None = None
    gamma: Float | None = None
    across: Array3f | None = None
    ground: Array3f | None = None
    there: Bool | None = None

    def shadow_origin(self, point: Array3f, to_lamp: Array3f) -> Array3f:
        """Origin of the shadow ray of the element at `point`, offset by its shadow bias so as to miss its own skin.

        The offset along the axis lets light in at grazing angles; it ends shadows too early. That towards the lamp
        moves none. Of a sheet it is on the side of the lamp.
        """
        if self.across is not None:
            point = dr.select(dr.dot(self.across, to_lamp) > 0.0, point + self.across, point)
        return (
            point if self.shadow_bias is None else dr.fma(self.axis + BIAS_TO_LAMP * to_lamp, self.shadow_bias, point)
        )

    def far_shadow_origin(self, point: Array3f, to_lamp: Array3f, distance: Float) -> tuple[Array3f, Float]:
        """Origin of a second shadow ray and its distance to the lamp: for an element with a shadow bias.

        It begins where the way to the lamp has left the element's own skin, and is nearer to the surface than the
        first ray: shadows of other matter end where they should.
        """
        assert self.shadow_bias is not None
        rise = dr.dot(self.axis, to_lamp)
        along = FAR_BIAS * self.shadow_bias * dr.rsqrt(dr.fmax(1.0 - rise * rise, LEAST_ACROSS**2))
        reach = dr.fmin(FAR_HEIGHT * self.shadow_bias * dr.rcp(dr.fmax(rise, LEAST_RISE)), distance)
        return dr.fma(self.axis, along, dr.fma(to_lamp, reach, point)), distance - reach


@dataclass
class TexelHit:
    """The place of a sample in a texel. The other fields mean nothing where `textured` is false."""

    textured: Bool  # whether the box of the sample has a texel
    box: UInt
    level: UInt  # row of its level, see `Textures`
    tau: Float  # extinction per unit of density [1/m]
    here: SurfacePoint
    frame: SurfaceFrame  # world axes
