"""The examples in docstrings run and give what they say; the public names that a reader starts with have one."""

import doctest
import importlib
from pathlib import Path

import pytest

import hagoromo as hg
from hagoromo.backend import mitsuba

PACKAGE = Path(hg.__file__).parent
FILES = [path for path in sorted(PACKAGE.rglob("*.py")) if ">>> " in path.read_text(encoding="utf-8")]
MODULES = [".".join(("hagoromo", *path.relative_to(PACKAGE).with_suffix("").parts)) for path in FILES]
EXPLAINED = """Board Camera Image Lamp Photograph Reflectance Response Scene Sensor Settings Spectrum Surface VolumeBox
build compare preview render""".split()


@pytest.mark.parametrize("module", MODULES)
def test_examples_give_what_they_say(module, tmp_path, monkeypatch):
    """In an empty folder, with `hg` and `np` as README imports them."""
    import numpy

    monkeypatch.chdir(tmp_path)
    if module.startswith("hagoromo_formats.mitsuba"):
        mitsuba()  # another test may have set a variant of Mitsuba that has none of our plugins
    module = importlib.import_module(module)
    result = doctest.testmod(module, extraglobs={"hg": hg, "np": numpy}, optionflags=doctest.NORMALIZE_WHITESPACE)
    assert result.attempted and not result.failed, module


@pytest.mark.parametrize("name", EXPLAINED)
def test_a_public_name_has_an_example(name):
    assert ">>> " in (getattr(hg, name).__doc__ or "")
