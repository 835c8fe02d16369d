"""Light of all orders in volume boxes, solved once on a coarse sparse grid: `--mode full`."""
