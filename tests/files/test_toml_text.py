"""Law: the TOML of plain data is read back as the same data."""

import tomllib

import pytest

from hagoromo.files.toml_text import toml_text

RECORD = {
    "number": 0.1 + 0.2,
    "tiny": 5e-324,
    "text": 'a "quoted"\tline\nand \x7f, \x00, ß, 𝄞, \\',
    "camera": {"eye": [0.0, -1, 1e300], "on": True, "odd key": {"x": 1, "é": []}},
    "lamp": [{"name": ""}, {"spectrum": {"wavelengths": [400, 700], "values": [1.0, 2.0]}}],
    "empty": [],
    "none": {},
}


def test_toml_of_plain_data_is_read_back_as_it_was():
    assert tomllib.loads(toml_text(RECORD)) == RECORD
    assert repr(tomllib.loads(toml_text(RECORD))["number"]) == repr(RECORD["number"])


def test_what_is_none_is_left_out():
    assert tomllib.loads(toml_text({"a": None, "b": {"c": None, "d": {"e": None}}})) == {"b": {"d": {}}}


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_that_no_scene_may_hold_are_not_written(value):
    with pytest.raises(ValueError):
        toml_text({"a": value})
