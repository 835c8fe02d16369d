"""Make the files of pinned versions and hashes anew: `make constraints`, or `make constraints UPGRADE=1`.

constraints.txt has one version of every package that the requirements of pyproject.toml bring, for every Python and
system of docs/machines.md, with the hashes of all its wheels. packaging/lowest.txt has the lowest versions that
pyproject.toml allows of what it names, which `make lowest` tests. Versions stay as they are where they can, but with
`--upgrade`. benchmarks/cycles.txt keeps its versions and gets its hashes.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
PYTHONS = ("3.11.5", "3.12", "3.13", "3.14")  # the site of the documents needs 3.11.5
SYSTEMS = ("x86_64-manylinux_2_28", "aarch64-manylinux_2_28", "aarch64-apple-darwin", "x86_64-pc-windows-msvc")
MACOS = "14.0"  # wheels of PyAV need it
WHEELS = ("--only-binary", ":all:")
CYCLES = "benchmarks/cycles.txt"
EVERYTHING = ("pyproject.toml", "--all-extras", "--group", "build")
PINNED = (*WHEELS, "--generate-hashes", "--custom-compile-command", "make constraints")


def compiled(*arguments: str) -> subprocess.CompletedProcess[str]:
    """The end of `uv pip compile`, which resolves requirements of any system on this one."""
    command = [sys.executable, "-m", "uv", "pip", "compile", "--quiet", *arguments]
    environment = {**os.environ, "MACOSX_DEPLOYMENT_TARGET": MACOS}
    return subprocess.run(command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False)


def main(options: list[str]) -> int:
    """Write the files; 1 where requirements contradict each other, or a system lacks a wheel."""
    everywhere = ("--universal", "--python-version", PYTHONS[0], "--fork-strategy", "fewest")
    here = ("--python-version", PYTHONS[0], "--python-platform", SYSTEMS[0], "--resolution", "lowest-direct")
    files = ("--output-file", "constraints.txt"), ("--output-file", "packaging/lowest.txt")
    failed = [
        compiled(*EVERYTHING, "--group", "pins", *PINNED, *everywhere, *files[0], *options),
        compiled(*EVERYTHING, *PINNED, *here, *files[1], *options),
        compiled(CYCLES, *PINNED, "--universal", "--python-version", "3.11", "--no-deps", "--output-file", CYCLES),
    ]
    for system in SYSTEMS:
        for python in PYTHONS:
            cell = ("--python-platform", system, "--python-version", python)
            failed.append(compiled("constraints.txt", *WHEELS, "--no-deps", "--offline", *cell))  # kept from above
            print(f"{system}, Python {python}: {'no' if failed[-1].returncode else 'all'} wheels", file=sys.stderr)
    messages = [done.stderr for done in failed if done.returncode]
    print("".join(messages), end="", file=sys.stderr)
    return 1 if messages else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
