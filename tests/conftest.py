"""Settings of every test: no window is opened, nothing comes from a cache, and threads do not wait for each other.

Those of NumPy's linear algebra and of Dr.Jit wait by spinning: several test processes that share the cores would spend
much of their time on that. So linear algebra keeps to one thread, and the kernels of laws and of measurements do where
pytest runs in many processes. Not those of all tests: Mitsuba waits for ever where it reads an EXR with one thread.
"""

import os

import drjit as dr
import pytest

from tests.data import NEEDS_DATA

os.environ["MPLBACKEND"] = "Agg"
os.environ["HAGOROMO_CACHE"] = "off"
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # read when NumPy and SciPy are first imported
ONE_THREAD = ("gradients", "inverse", "laws")  # folders of tests in which Mitsuba reads no file


def pytest_configure(config):
    """Processes that tests start write no bytecode: some are cut off as they write, and half a file would stop all."""
    if hasattr(config, "workerinput") or not getattr(config.option, "numprocesses", None):
        os.environ["PYTHONDONTWRITEBYTECODE"] = "1"


@pytest.fixture
def few_match_points(monkeypatch):
    """Texels are matched at few points, a fifth of the time: for tests that do not ask how well their levels match."""
    from hagoromo_matter.texel import texel_match

    for name, count in (("POINTS", 1 << 10), ("DRAWN", 64)):
        monkeypatch.setattr(texel_match, f"{name}_OF_FINEST", count)
        monkeypatch.setattr(texel_match, f"{name}_OF_COARSE", count)


@pytest.fixture(autouse=True)
def nothing_stays_kept():
    """What a test fetched from a store is not kept for the next one: it would count other bytes."""
    yield
    from hagoromo.files import stores

    assert stores.kept.most == 0


@pytest.fixture(autouse=True)
def kernels_keep_to_one_thread(request):
    """In processes beside others, for the tests of ONE_THREAD."""
    before = dr.thread_count()
    if "PYTEST_XDIST_WORKER" in os.environ and request.path.parent.name in ONE_THREAD:
        dr.set_thread_count(1)
    yield
    dr.set_thread_count(before)


@pytest.fixture
def exact_derivatives():
    """For tests of derivatives in double precision: Dr.Jit takes reciprocals in them that are good to 1e-6 on CUDA."""
    from hagoromo.backend import name

    if name() == "cuda":
        pytest.skip("derivatives in double precision are good to 1e-6 here")


@pytest.fixture
def double_precision():
    """Relative error of closed forms in double precision: on CUDA Dr.Jit's reciprocals and roots are good to 1e-7."""
    from hagoromo.backend import name

    return 1e-6 if name() == "cuda" else 1e-9


def pytest_collection_modifyitems(items):
    """A test in a browser, or with real data, is one for the night, and so are the cases that `by_night` names."""
    for item in items:
        cases = [case for mark in item.iter_markers("by_night") for case in mark.args]
        if cases and item.callspec.id in cases:
            item.add_marker(pytest.mark.nightly)
        reasons = [str(mark.kwargs.get("reason", "")) for mark in item.iter_markers("skipif")]
        if "browser" in item.fixturenames or any(reason.startswith(NEEDS_DATA) for reason in reasons):
            item.add_marker(pytest.mark.nightly)
