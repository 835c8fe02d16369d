"""Self-calibration: far lamps from the photographs of the object itself, where there is no ball."""

from hagoromo.photograph.self_calibration.lamps import SelfCalibration as SelfCalibration
from hagoromo.photograph.self_calibration.lamps import self_calibrate as self_calibrate
