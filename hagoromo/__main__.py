"""The command `hagoromo` as `python -m hagoromo`."""

import sys

from hagoromo_start import main

if __name__ == "__main__":
    sys.exit(main())
