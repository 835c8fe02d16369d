"""Importing the package loads little and changes nothing."""

import ast
import importlib
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

import hagoromo

HEAVY = ("numpy", "drjit", "mitsuba", "colour", "matplotlib", "cv2", "scipy", "zarr")


def run(code: str) -> str:
    command = [sys.executable, "-c", textwrap.dedent(code)]
    return subprocess.run(command, capture_output=True, text=True, check=True).stdout


def test_import_loads_little_and_nothing_heavy():
    """Some twenty modules beside Python's own: a few hundredths of a second."""
    code = f"""
        import os, sys
        before, modules = dict(os.environ), len(sys.modules)
        import hagoromo
        assert dict(os.environ) == before
        print(len(sys.modules) - modules, *(name for name in {HEAVY} if name in sys.modules))
    """
    count, *heavy = run(code).split()
    assert int(count) < 60 and not heavy


def test_no_mitsuba_variant_is_set_by_import():
    assert run("import hagoromo, mitsuba; print(mitsuba.variant())").strip() == "None"


def test_every_module_is_imported_without_a_warning():
    """Nothing that the next Python or library takes away is used, as far as importing shows it."""
    code = """
        import importlib, pkgutil
        import hagoromo, hagoromo_formats, hagoromo_matter, hagoromo_page

        for package in (hagoromo, hagoromo_formats, hagoromo_matter, hagoromo_page):
            for module in pkgutil.walk_packages(package.__path__, package.__name__ + "."):
                if not module.name.endswith("__main__"):
                    importlib.import_module(module.name)
    """
    command = [sys.executable, "-X", "dev", "-W", "error", "-c", textwrap.dedent(code)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0 and done.stderr == "", done.stderr


def stub() -> list[ast.ImportFrom]:
    tree = ast.parse(Path(hagoromo.__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.ImportFrom)]


@pytest.mark.parametrize("name", [alias.name for node in stub() for alias in node.names])
def test_every_public_name_is_there(name):
    assert getattr(hagoromo, name) is not None
    assert name in dir(hagoromo)


def test_types_and_values_of_the_public_names_come_from_the_same_places():
    for node in stub():
        module = importlib.import_module(f"hagoromo.{node.module}" if node.level else str(node.module))
        for alias in node.names:
            assert alias.asname == alias.name and getattr(hagoromo, alias.name) is getattr(module, alias.name)


def test_no_public_name_hides_a_room_of_the_package():
    rooms = {path.stem for path in Path(hagoromo.__file__).parent.iterdir() if path.suffix in ("", ".py")}
    assert not rooms & set(dir(hagoromo))


@pytest.mark.parametrize("package", ["hagoromo", "hagoromo_formats", "hagoromo_matter", "hagoromo_page"])
def test_the_packages_say_that_they_are_typed(package):
    assert (Path(hagoromo.__file__).parents[1] / package / "py.typed").is_file()


def test_another_name_is_an_attribute_error():
    with pytest.raises(AttributeError, match="attribute nonsense"):
        _ = hagoromo.nonsense  # pyrefly: ignore[missing-attribute]
