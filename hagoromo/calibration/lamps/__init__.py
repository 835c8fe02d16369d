"""Lamps from photographs: of chrome balls, of a matte reference, or of the object itself."""

from hagoromo.calibration.lamps.ball import Ball as Ball
from hagoromo.calibration.lamps.ball import find_ball as find_ball
from hagoromo.calibration.lamps.highlight import Highlight as Highlight
from hagoromo.calibration.lamps.highlight import find_highlight as find_highlight
from hagoromo.calibration.lamps.lamps_from_ball import lamps_from_ball as lamps_from_ball
from hagoromo.calibration.lamps.place import LampPlace as LampPlace
from hagoromo.calibration.lamps.place import locate_lamp as locate_lamp
from hagoromo.calibration.lamps.reading import LampReading as LampReading
from hagoromo.calibration.lamps.reading import Strength as Strength
from hagoromo.calibration.lamps.reading import highlight_strength as highlight_strength
from hagoromo.calibration.lamps.reading import read_lamp as read_lamp
from hagoromo.calibration.lamps.reference import Reference as Reference
from hagoromo.calibration.lamps.reference import find_matte_ball as find_matte_ball
from hagoromo.calibration.lamps.reference import matte_ball as matte_ball
from hagoromo.calibration.lamps.reference import matte_card as matte_card
from hagoromo.calibration.lamps.reference import reference_strength as reference_strength
from hagoromo.light.lamp_spread import LampSpread as LampSpread
from hagoromo.light.lamp_spread import check_spread as check_spread
