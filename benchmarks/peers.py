"""Hagoromo and its peers on the same scenes, in one run: time, error, memory and first picture of each.

    python benchmarks/peers.py [--rounds 5] [--out out/bench] [--only WORD]

Each contender runs in a process of its own (peers_child.py) behind one function, `frames(scene)`: peers_hagoromo.py,
peers_mitsuba.py, peers_numba.py, peers_numpy.py, peers_vtk.py, peers_vtk_gpu.py. Ours and theirs render in turn, one
while the other waits. What is not installed gets a row that says so. The scenes: peers_scene.py; the turns and errors:
peers_contest.py; the table: peers_table.py.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path

from peers_contest import PeerContest
from peers_scene import STUDIES, make_matter
from peers_table import write


def main() -> None:
    """Run every study and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--out", type=Path, default=Path("out/bench"))
    parser.add_argument("--only", default="", help="run the scenes whose name has this word")
    options = parser.parse_args()
    start, rows = time.perf_counter(), []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        print("making the matter", flush=True)
        make_matter(folder)
        for number, study in enumerate(STUDIES):
            if options.only in study.name:
                rows += PeerContest(number, folder, options.rounds).rows()
                paths = write(options.out, rows)  # again after every scene: an interrupted run keeps what it has
                print(f"  {time.perf_counter() - start:.0f} s so far:", *paths, flush=True)


if __name__ == "__main__":
    main()
