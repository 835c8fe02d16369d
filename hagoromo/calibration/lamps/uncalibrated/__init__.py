"""Self-calibration: far lamps from the photographs of the object itself, where there is no ball."""

from hagoromo.calibration.lamps.uncalibrated.far_lamps import SelfCalibration as SelfCalibration
from hagoromo.calibration.lamps.uncalibrated.far_lamps import self_calibrate as self_calibrate
