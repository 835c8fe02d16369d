"""Run studies by name: `python -m studies NAME...` from the root of the repository; without a name, list them.

Options after one name are given to the first command of that study, behind its own; then nothing is copied into the
documents: `python -m studies random-scenes --first 1000 --scenes 4`.
"""

from __future__ import annotations

import glob
import os
import shutil
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

from studies.table_of_studies import STUDIES, Study

DEMO = ("-m", "hagoromo", "demo", "--out", "out/demo", "--force")


def main(words: Sequence[str]) -> int:
    """Run studies by their names, in turn, or one with options; the exit status: that of the first that fails,
    2 for an unknown name.
    """
    count = next((k for k, word in enumerate(words) if word.startswith("-")), len(words))
    names, options = words[:count], words[count:]
    if not names and (not options or options[0] in ("-h", "--help")):
        print(listed())
        return 0
    if options and len(names) != 1:
        print(f"{options[0]} stands behind {len(names)} names: options are for one study", file=sys.stderr)
        return 2
    unknown = [name for name in names if name not in STUDIES]
    if unknown:
        print(f"there is no study {unknown[0]!r}: give one of {', '.join(STUDIES)}", file=sys.stderr)
        return 2
    return next((status for name in names if (status := run(STUDIES[name], options))), 0)


def listed() -> str:
    """The studies, a line each: name, what it shows, how long it takes."""
    width = max(map(len, STUDIES))
    rows = (f"  {name:<{width}}  {study.shows} ({study.takes})" for name, study in STUDIES.items())
    return "\n".join(("usage: python -m studies NAME... or python -m studies NAME OPTIONS", *rows))


def run(study: Study, options: Sequence[str] = ()) -> int:
    """Run the commands of `study` and copy its results into the documents, or its first command with `options`; the
    exit status of the first that fails.
    """
    one_thread = {"OPENBLAS_NUM_THREADS": "1", **os.environ}  # two processes with two threads each wait for each other
    demo = (DEMO,) if study.needs_demo and not Path("out/demo/measure").exists() else ()
    runs = ((*study.runs[0], *options),) if options else study.runs
    for arguments in (*demo, *runs):
        status = subprocess.run([sys.executable, *arguments], env=one_thread, check=False).returncode
        if status:
            return status
    for pattern, target in () if options else study.copies:
        for source in sorted(glob.glob(pattern)):
            Path(target if Path(target).suffix else f"{target}/").parent.mkdir(parents=True, exist_ok=True)
            shutil.copy(source, target)
            print(f"{source} -> {target}")
    return 0


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
