"""Fuzzer: spoilt files of every kind that the package reads, and spoilt sessions of its viewer, must be refused in one
line, or read.

    python -m fuzz                                # every reader, a fixed count of mutations
    python -m fuzz --reader wif --seed 1234       # one mutation again
    python -m fuzz --swaps                        # each node of each JSON and TOML file by a value of each type
    python -m fuzz --minutes 15                   # more and more seeds, until the time is over (make fuzz)

`readers` is the table of readers, each with a good sample; `mutators` spoils samples; `judge` decides; `corpus` holds
files that once failed.
"""

import os

os.environ["HAGOROMO_CACHE"] = "off"  # every command does its work, each time
