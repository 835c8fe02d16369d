"""Settings of every test: no window is ever opened."""

import os

os.environ["MPLBACKEND"] = "Agg"
