"""Settings of every test: no window is ever opened, and NumPy's linear algebra keeps to one thread.

Its threads wait by spinning: several test processes that share the cores would spend most of their time on that.
"""

import os

os.environ["MPLBACKEND"] = "Agg"
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy and SciPy are first imported
