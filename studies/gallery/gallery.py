"""Gallery: every recipe close up, whole and under a lamp that moves around it, as docs/gallery.md; what each costs.

    python -m studies.gallery.gallery examples/recipes --out docs

Every item is built and rendered in a process of its own, so that its peak of memory is its own.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

import hagoromo as hg
from studies.gallery.gallery_items import ITEMS
from studies.gallery.gallery_page import write_page


def main() -> int:
    """Make the items that are named, or all, and the page of those that have been made."""
    parser = argparse.ArgumentParser(description="The gallery of all recipes.")
    parser.add_argument("recipes", type=Path, help="folder of the recipes")
    parser.add_argument("--out", type=Path, required=True, help="folder of gallery.md and figures/gallery")
    parser.add_argument("--only", nargs="*", choices=ITEMS, help="make these anew; the others stay as they are")
    parser.add_argument("--data", type=Path, default=Path("../shared/data"), help="folder that has the scan")
    arguments = parser.parse_args()
    figures = arguments.out / "figures" / "gallery"
    figures.mkdir(parents=True, exist_ok=True)
    failed = []
    for name in arguments.only or ITEMS:
        scan = arguments.data / ITEMS[name].scan
        if not scan.exists():
            print(f"{name}: left as it is, {scan} is not there", flush=True)
            continue
        command = [
            sys.executable,
            "-m",
            "studies.gallery.gallery_item",
            str(arguments.recipes),
            name,
            str(figures),
            str(arguments.data),
        ]
        print(name, flush=True)
        if subprocess.run(command, check=False).returncode:
            failed.append(name)
    costs = {name: hg.read_json(figures / f"{name}.json") for name in ITEMS if (figures / f"{name}.json").exists()}
    write_page(arguments.out / "gallery.md", arguments.recipes, costs)
    print(f"wrote {arguments.out / 'gallery.md'}")
    if failed:
        print(f"failed: {', '.join(failed)}", file=sys.stderr)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
