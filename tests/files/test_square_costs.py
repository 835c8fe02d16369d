"""Files whose reading could take the square of their size in time or memory are read or refused within bounds."""

import json
import tomllib

import pytest

from fuzz.costs import costs
from hagoromo.errors import InputError
from hagoromo.files.record import DEEPEST, read_json, read_toml

MANY = 20_000
KEYS = ",".join(f'"{k}":0' for k in range(2 * MANY))
PARTS = f"key of more than {DEEPEST} parts"
CASES = {
    "a key of many parts": ("a.toml", "a." * MANY + "a = 1\n", PARTS),
    "in quotes and spaces": ("a.toml", "\n\t'a' . \"a\\\"\" ." + " a-1 ." * MANY + " a = 1\n", PARTS),
    "of a table": ("a.toml", "[[ " + "a." * MANY + "a ]]\n", PARTS),
    "of a table on one line": ("a.toml", "t = [{b = 1, " + "a." * MANY + "a = 1}]\n", PARTS),
    "quotes that are never closed": ("a.toml", '\\"' * (50 * MANY), "is not valid TOML"),
    "commas and quotes": ("a.toml", ",'" * MANY + ',"' * MANY, "is not valid TOML"),
    "a key twice among many": ("a.json", f'{{{KEYS},"{2 * MANY - 1}":1}}', f"states the key '{2 * MANY - 1}' twice"),
}  # fmt: skip


@pytest.mark.parametrize("name", CASES)
def test_no_text_takes_the_square_of_its_size(tmp_path, name):
    """Each took minutes, or all memory, where its cost grew with the square: the bounds are those of the fuzzer."""
    file, text, refusal = CASES[name]
    (tmp_path / file).write_text(text)
    with costs() as wrong, pytest.raises(InputError, match=refusal):
        (read_json if file.endswith("json") else read_toml)(tmp_path / file)
    assert not wrong()


@pytest.mark.parametrize("parts, refused", [(DEEPEST, False), (DEEPEST + 1, True)])
def test_keys_of_few_parts_are_read(tmp_path, parts, refused):
    """Texts and comments may have as many dots as they like."""
    dots = ".".join("a" * (2 * DEEPEST))
    text = f't = "in {dots}" # or {dots}\n' + ".".join("k" * parts) + " = 1\n"
    (tmp_path / "a.toml").write_text(text)
    if refused:
        with pytest.raises(InputError, match=PARTS):
            read_toml(tmp_path / "a.toml")
    else:
        assert read_toml(tmp_path / "a.toml") == tomllib.loads(text)


def test_costs_are_counted(tmp_path, monkeypatch):
    """What computes, and what takes memory, is told; the bounds are lowered, not to take as much here."""
    monkeypatch.setattr("fuzz.costs.MOST_SECONDS", 0.05)
    monkeypatch.setattr("fuzz.costs.MOST_MEMORY", 50 << 20)
    with costs() as wrong:
        json.dumps([0.1] * 1_000_000)
    assert "of computing" in wrong()
    monkeypatch.setattr("fuzz.costs.MOST_SECONDS", 20.0)
    with costs() as wrong:
        bytearray(200 << 20)
    assert "of memory" in wrong()
