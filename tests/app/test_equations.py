"""The page that maps equations to tests: every equation of the model stands there, and all that it names exists."""

import re
from pathlib import Path

HOME = Path(__file__).parents[2]
PAGE = (HOME / "docs" / "equations.md").read_text(encoding="utf-8")


def test_every_equation_of_the_model_has_its_tests():
    tags = {
        tag
        for page in (HOME / "docs" / "model").glob("*.md")
        for tag in re.findall(r"\\tag\{(\d+)\}", page.read_text("utf-8"))
    }
    rows = [line.split("|") for line in PAGE.splitlines() if re.match(r"\| \(\d", line)]
    stated = {number: row for row in rows for number in re.findall(r"\((\d+)\)", row[1])}
    assert tags and tags <= stated.keys()
    assert all("`tests/" in row[4] and "`hagoromo/" in row[3] for row in stated.values())


def test_what_the_page_names_exists():
    names = re.findall(r"`((?:tests|hagoromo)/[^`]*)`", PAGE)
    assert len(names) > 50
    for name in names:
        path, _, test = name.partition("::")
        assert (HOME / path).is_file(), name
        assert not test or f"def {test}(" in (HOME / path).read_text(encoding="utf-8"), name
