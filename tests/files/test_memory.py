"""The memory that is free is the least of the machine's, the control groups' and the process's limits."""

import subprocess
import sys

import psutil
import pytest

from hagoromo.errors import InputError
from hagoromo.files import memory

GIB = 2**30


@pytest.fixture
def groups(tmp_path, monkeypatch):
    """A tree of control groups that the process believes to be its own."""
    (tmp_path / "own").write_text("5:cpu:/\n4:cpuset,memory:/job/step\n0::/job/step\n")
    monkeypatch.setattr(memory, "OWN_GROUPS", tmp_path / "own")
    monkeypatch.setattr(memory, "GROUPS", tmp_path / "cgroup")
    return tmp_path / "cgroup"


def write_group(folder, **files) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    for name, text in files.items():
        (folder / name.replace("__", ".")).write_text(f"{text}\n")


def test_a_group_of_version_2_leaves_its_limit_less_what_cannot_be_dropped(groups):
    write_group(groups / "job/step", memory__max=3 * GIB, memory__current=2 * GIB)
    write_group(groups / "job/step", memory__stat=f"anon {GIB}\ninactive_file {GIB}\nfile {GIB}")
    assert list(memory._left_by_groups()) == [2 * GIB]


def test_a_group_of_version_1_counts_and_its_largest_number_is_no_limit(groups):
    write_group(groups / "memory", memory__limit_in_bytes=2**63 - 4096, memory__usage_in_bytes=GIB)
    write_group(groups / "memory/job/step", memory__limit_in_bytes=GIB, memory__usage_in_bytes=GIB // 4)
    assert list(memory._left_by_groups()) == [3 * GIB // 4]


def test_a_group_above_that_is_smaller_counts(groups):
    write_group(groups / "job", memory__max=GIB, memory__current=GIB // 2)
    write_group(groups / "job/step", memory__max="max", memory__current=0)
    assert list(memory._left_by_groups()) == [GIB // 2]


def test_within_a_container_the_group_at_the_top_counts(groups):
    write_group(groups, memory__max=GIB, memory__current=0)
    assert list(memory._left_by_groups()) == [GIB]


def test_a_system_without_control_groups_or_limits_has_what_is_free(groups, monkeypatch):
    (groups.parent / "own").unlink()
    monkeypatch.delattr(psutil.Process, "rlimit", raising=False)
    assert not [*memory._left_by_groups(), *memory._left_by_limits()]
    assert 0 < memory.free_memory() <= psutil.virtual_memory().total


@pytest.mark.skipif(sys.platform != "linux", reason="other systems do not heed these limits")
@pytest.mark.parametrize("limit", ["RLIMIT_AS", "RLIMIT_DATA"])
def test_a_limit_of_the_process_counts(limit):
    code = (
        f"import resource; resource.setrlimit(resource.{limit}, (2**30, 2**30));"
        "from hagoromo.files.memory import free_memory; print(free_memory())"
    )
    free = int(subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout)
    assert 0 < free < GIB


def test_what_does_not_fit_is_refused_with_both_sizes(monkeypatch):
    monkeypatch.setattr(memory, "free_memory", lambda: GIB)
    memory.require(0.9 * GIB, "the lattice")
    for size in (0.91 * GIB, float("inf"), float("nan")):
        with pytest.raises(InputError, match=r"the lattice needs .* GiB of memory and 1 GiB are free"):
            memory.require(size, "the lattice")


@pytest.mark.parametrize(
    "error",
    [MemoryError(), RuntimeError("jit_malloc(): out of memory! Could not allocate"), RuntimeError("std::bad_alloc"),
     ImportError("libLLVM.so: failed to map segment from shared object"), RuntimeError("can't start new thread")],
)  # fmt: skip
def test_a_lack_of_memory_is_known_by_any_name_and_said_in_one_line(error):
    assert memory.is_shortage(error) and not memory.is_shortage(ValueError("a bug"))
    assert "\n" not in memory.shortage(error)


def test_a_lack_of_memory_on_the_gpu_does_not_tell_what_the_host_has():
    """As Dr.Jit says it on a card."""
    said = (
        "drjit.make_opaque(): error encountered while processing an argument of type 'drjit.cuda.ad.Float': "
        "jit_malloc(): out of memory! Could not allocate 8589934592 bytes (backend=CUDA, shared=0)."
    )
    error = RuntimeError(said)
    assert memory.is_shortage(error)
    assert memory.shortage(error).startswith("the memory of the GPU is not enough (")
    assert "are free" in memory.shortage(RuntimeError(said.replace("CUDA, shared=0", "LLVM, shared=0")))
