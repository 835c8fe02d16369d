"""What photographs themselves say of order, lamps, strengths, transfer, motion, blur, mask and calibration."""
