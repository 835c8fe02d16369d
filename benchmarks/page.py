"""The page of performance: the records as tables and plots, put into docs/performance.md between their marks.

What stands between `<!-- march -->` and `<!-- end -->` is made from out/bench/march.json, and so on; text outside of
marks is written by hand and has no measured figure in it. What has no record stays as it is.

    python benchmarks/page.py
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from plots import bound, growth
from tables import (
    bound_table,
    equal_error_table,
    formats_table,
    march_table,
    matter_memory_table,
    open_table,
    orders_table,
    page_frames_table,
    scale_table,
    scaling_table,
    spectra_image_table,
)
from turns import RECORDS

from hagoromo.files.record import read_json
from hagoromo.files.whole import whole_file

PAGE = Path("docs/performance.md")
FIGURES = PAGE.parent / "figures"
TABLES = {
    "march": march_table, "scaling": scaling_table, "scale": scale_table, "bound": bound_table,
    "equal_error": equal_error_table, "page_frames": page_frames_table,
    "spectra_image": spectra_image_table, "formats": formats_table, "matter_memory": matter_memory_table,
}  # fmt: skip
ORDERS = "smoke", "cloth", "hair", "figure8"  # scenes of orders.py, in this order
PLOTS = {"scaling": growth, "bound": bound}


def main() -> None:
    """Refresh the page and its figures from the records that are there."""
    text = PAGE.read_text(encoding="utf-8")
    for name, table in TABLES.items():
        source = RECORDS / f"{name}.json"
        if source.exists():
            held = read_json(source)
            text = replaced(text, name, f"{taken_on(held['machine'])}\n\n{table(held['figures'])}")
            if name in PLOTS:
                PLOTS[name](held["figures"], FIGURES / f"{name}.png")
    pieces = [read_json(source) for name in ORDERS if (source := RECORDS / f"orders_{name}.json").exists()]
    if pieces:
        parts = [f"{orders_table(held['figures'])}\n\n{taken_on(held['machine'])}" for held in pieces]
        text = replaced(text, "orders", "\n\n".join(parts))
    opened = RECORDS / "open_box.json"
    if opened.exists():
        held = read_json(opened)
        text = replaced(text, "open_box", f"*{held['date']}; {held['machine']}*\n\n{open_table(held['boxes'])}")
    peers = RECORDS / "peers.md"
    if peers.exists():
        text = replaced(text, "peers", peers.read_text(encoding="utf-8").split("\n", 1)[1].strip())
    with whole_file(PAGE, force=True) as file:
        file.write_text(text, encoding="utf-8", newline="\n")
    print(f"{PAGE} written")


def replaced(text: str, name: str, body: str) -> str:
    """The text with `body` between the marks of `name`; `ValueError` without them."""
    marks = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end -->)", re.DOTALL)
    if not marks.search(text):
        raise ValueError(f"no marks for {name}: write <!-- {name} --> and <!-- end --> where it belongs")
    return marks.sub(lambda found: f"{found[1]}{body}\n{found[2]}", text)


def taken_on(machine: Mapping[str, Any]) -> str:
    """The machine, the versions and the date, in one line."""
    versions = ", ".join(f"{name} {number}" for name, number in machine["versions"].items())
    return (
        f"*{machine['date']}; {machine['processor']}, {machine['cores']} cores, load {machine['load']:.1f} at the end, "
        f"backend {machine['backend']}; {machine['system']}, Python {machine['python']}; {versions}*"
    )


if __name__ == "__main__":
    main()
