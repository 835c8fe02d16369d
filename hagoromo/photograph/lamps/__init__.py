"""Lamps from photographs: of chrome balls, of a matte reference, or of the object itself."""

from hagoromo.photograph.lamps.ball import Ball as Ball
from hagoromo.photograph.lamps.ball import find_ball as find_ball
from hagoromo.photograph.lamps.calibrate import calibrate_lamps as calibrate_lamps
from hagoromo.photograph.lamps.highlight import Highlight as Highlight
from hagoromo.photograph.lamps.highlight import LampReading as LampReading
from hagoromo.photograph.lamps.highlight import find_highlight as find_highlight
from hagoromo.photograph.lamps.highlight import read_lamp as read_lamp
from hagoromo.photograph.lamps.place import LampPlace as LampPlace
from hagoromo.photograph.lamps.place import locate_lamp as locate_lamp
from hagoromo.photograph.lamps.reference import Reference as Reference
from hagoromo.photograph.lamps.reference import find_matte_ball as find_matte_ball
from hagoromo.photograph.lamps.reference import matte_ball as matte_ball
from hagoromo.photograph.lamps.reference import matte_card as matte_card
from hagoromo.photograph.lamps.reference import reference_strength as reference_strength
from hagoromo.photograph.lamps.spread import Spread as Spread
from hagoromo.photograph.lamps.spread import check_spread as check_spread
from hagoromo.photograph.lamps.strength import Strength as Strength
from hagoromo.photograph.lamps.strength import highlight_strength as highlight_strength
