"""Beams of near lamps: a file each. The one that a lamp has follows from its keys."""

from hagoromo.light.beams.beam import Beam, BeamKeys
from hagoromo.light.beams.profile import ProfileBeam
from hagoromo.light.beams.spot import SpotBeam
from hagoromo.light.beams.uniform import UniformBeam

BEAMS: tuple[type[Beam], ...] = (ProfileBeam, SpotBeam, UniformBeam)


def beam_of(keys: BeamKeys) -> Beam:
    """The first beam that the keys of a lamp, checked by `Lamp`, mean."""
    return next(beam for kind in BEAMS for beam in (kind.of(keys),) if beam is not None)
