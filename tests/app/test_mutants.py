"""The tool that changes numbers of laws: what it changes, and what is noticed."""

import pytest

from tests.mutants import HOME, drawn, mutants_of, nearest_tests, survives

SOURCE = '''"""A law with 3 numbers."""
HALF = 0.5
def f(x: int = 2, *, axis=0) -> "tuple[int, 3]":
    assert x > 7
    return HALF * x[1] + sum(x, axis=9)
'''


def test_numbers_of_the_law_alone_are_changed():
    found = {(one.line, one.was, one.becomes) for one in mutants_of("a.py", SOURCE)}
    assert found == {(2, "0.5", "0.51"), (3, "2", "3"), (3, "0", "1")}
    (half,) = (one for one in mutants_of("a.py", SOURCE) if one.was == "0.5")
    assert half.text(SOURCE) == SOURCE.replace("0.5", "0.51")


def test_the_page_says_which_tests_are_near():
    near = nearest_tests((HOME / "docs" / "equations.md").read_text(encoding="utf-8"))
    assert any("test_facets" in test for test in near["hagoromo/reflectance/facets.py"])
    assert len(drawn(near, 10, 1)) == 10 and drawn(near, 10, 1) == drawn(near, 10, 1) != drawn(near, 10, 2)


@pytest.mark.nightly
def test_a_mutant_is_noticed_or_survives(tmp_path):
    (tmp_path / "law.py").write_text("TWO = 2\nUNUSED = 5\n")
    (tmp_path / "test_law.py").write_text("from law import TWO\ndef test_two():\n    assert TWO == 2\n")
    source = (tmp_path / "law.py").read_text()
    two, unused = mutants_of("law.py", source)
    assert not survives(two, ["test_law.py"], tmp_path) and survives(unused, ["test_law.py"], tmp_path)
    assert (tmp_path / "law.py").read_text() == source
