"""The page about the machine: it tells whether kernels are right, says what to do if not, and holds no private data."""

import json
import os
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo import backend
from hagoromo.app import doctor as doctor_module
from hagoromo.app import try_kernels
from hagoromo.app.cli import main
from hagoromo.errors import InputError

SECTIONS = ("hagoromo", "python", "system", "processor", "memory", "disk", "backends", "kernel", "kernel_cache")
SECTIONS = (*SECTIONS, "terminal", "environment", "libraries")


def test_the_page_says_that_this_machine_can_render(capsys):
    assert main(["doctor"]) == 0
    page = capsys.readouterr().out
    assert page.endswith("\nThis machine can render.\n")
    titles = [line for line in page.splitlines() if line and not line.startswith(" ")]
    assert titles == [*SECTIONS, "This machine can render."]
    assert f"version: {hg.__version__}" in page and f"numpy {np.__version__}" in page
    assert f"used: {backend.name()}" in page
    assert len(page.splitlines()) < 80  # one page


def test_json_holds_no_name_of_the_home_folder_and_no_variable_that_is_not_listed(capsys, monkeypatch, tmp_path):
    home = tmp_path / "alice"
    home.mkdir()
    monkeypatch.setenv("HOME", str(home))
    monkeypatch.setenv("USERPROFILE", str(home))
    monkeypatch.setenv("MPLCONFIGDIR", str(home / "matplotlib"))
    monkeypatch.setenv("XDG_CACHE_HOME", f"{home}-elsewhere")
    monkeypatch.setenv("A_TOKEN", "hunter2")
    assert main(["doctor", "--json"]) == 0
    text = capsys.readouterr().out
    facts = json.loads(text)
    assert facts["can_render"] is True and facts["why_not"] is None and facts["kernel"]["state"] == "right"
    assert facts["environment"]["MPLCONFIGDIR"] == f"~{os.sep}matplotlib"
    assert facts["environment"]["XDG_CACHE_HOME"] == f"{home}-elsewhere"  # another folder
    assert "hunter2" not in text and str(home) + os.sep not in text
    assert facts["backends"]["used"] == backend.name()


def test_without_a_backend_the_last_line_says_what_to_install(capsys, monkeypatch, tmp_path):
    monkeypatch.setenv("HAGOROMO_BACKEND", "llvm")
    monkeypatch.setenv("DRJIT_LIBLLVM_PATH", str(tmp_path / "absent.so"))
    assert main(["doctor"]) == 1
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("This machine cannot render: ") and "libLLVM is missing; install it" in last


def test_a_home_that_cannot_be_written_is_no_fault(capsys, monkeypatch):
    """Dr.Jit's kernels are compiled anew then."""
    monkeypatch.setenv("HOME", os.path.join(os.devnull, "nobody"))
    monkeypatch.delenv("DRJIT_CACHE_DIR", raising=False)
    if sys.platform == "win32":
        pytest.skip("the cache does not lie in the home folder")
    assert main(["doctor", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["kernel_cache"]["state"].startswith("absent")


def test_wrong_numbers_are_found(monkeypatch, tmp_path):
    right = try_kernels.transmittances
    monkeypatch.setattr(try_kernels, "transmittances", lambda steps: right(steps) * 1.0001)
    try_kernels.try_kernels(tmp_path / "answer.json")
    facts = json.loads((tmp_path / "answer.json").read_text(encoding="utf-8"))
    assert facts["can_render"] is False and facts["kernel"]["state"] == "wrong"
    assert "wrong numbers" in facts["why_not"]


@pytest.mark.skipif(sys.platform == "win32", reason="the process that ends is a shell script")
def test_a_backend_that_ends_its_process_is_told(capsys, monkeypatch, tmp_path):
    script = tmp_path / "python"
    script.write_text('#!/bin/sh\necho \'{"backends": {"used": "llvm"}}\' > "$4"\necho torn >&2\nkill -6 $$\n', "utf-8")
    script.chmod(0o755)
    monkeypatch.setattr(sys, "executable", str(script))
    assert main(["doctor"]) == 1
    said = capsys.readouterr().out
    assert "used: llvm" in said and "ended with status -6 (torn): try another libLLVM" in said.splitlines()[-1]


def test_the_doctor_loads_nothing_heavy_before_it_is_asked():
    code = "import sys, hagoromo.app.doctor; print(*{'drjit', 'mitsuba', 'numpy', 'psutil'} & set(sys.modules))"
    assert subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout == "\n"


@pytest.mark.parametrize(
    ("home", "text", "shown"),
    [("/home/al", "/home/al/x:/home/alice", "~/x:/home/alice"), ("/", "/usr/bin", "/usr/bin")],
)
def test_only_the_home_folder_is_shortened(monkeypatch, home, text, shown):
    monkeypatch.setattr(doctor_module.Path, "home", lambda: doctor_module.Path(home))
    assert doctor_module._without_home({"a": [text]}) == {"a": [shown]}


def test_a_gpu_without_its_library_of_ray_tracing_is_told_in_one_line(monkeypatch):
    """As Mitsuba says it on a card in a container that has CUDA alone; other faults stay as they are."""
    said = 'At dictionary node "root": failed to instantiate scene plugin of type "scene": Could not initialize OptiX!'

    def fails(message):
        def load_dict(_):
            raise RuntimeError(message)

        monkeypatch.setattr(backend, "mitsuba", lambda: SimpleNamespace(load_dict=load_dict))

    fails(said)
    with pytest.raises(InputError, match=r"OptiX does not start: install .* or set HAGOROMO_BACKEND=llvm"):
        backend.traced_scene({"ball": {"type": "sphere"}})
    fails("something else")
    with pytest.raises(RuntimeError, match="something else"):
        backend.traced_scene({"ball": {"type": "sphere"}})
