"""The page of the first order is made from its records, and says which scenes have no figures of before."""

import copy
import json
from typing import Any

from studies.first_order import BEFORE, longest_steps
from studies.first_order_page import write_first_order_page


def test_the_page_tells_errors_before_and_now(tmp_path):
    before = json.loads(BEFORE.read_text(encoding="utf-8"))
    now: dict[str, Any] = {**copy.deepcopy(before), "longest_step_voxel": longest_steps()}
    for row in now["rows"]:
        row["error"] /= 2.0
    now["rows"] += [{**row, "scene": "a new scene"} for row in now["rows"] if row["scene"] == "hard ball"]
    now["pictures"] = {name: {**shown, "true": shown["seen"]} for name, shown in before["pictures"].items()}
    write_first_order_page(tmp_path, now, before)
    page = (tmp_path / "first_order.md").read_text(encoding="utf-8")
    assert "| hard ball | 2.15 → 1.07 % |" in page
    assert "| marched shadows | 0.04 | 1.5 | 0.752 →" in page
    assert "| a new scene | 1.07 % |" in page
    assert {path.name for path in tmp_path.glob("*.png")} == {"first_order.png", "first_order_maps.png"}
