"""What a machine is and whether it can render: facts for a report of a fault, without private data."""

from __future__ import annotations

import json
import locale
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from hagoromo.version import __version__

WAIT_S = 600.0  # for the kernels; on a first run, on a busy machine, they are compiled for some seconds
ENVIRONMENT = (
    "HAGOROMO_BACKEND", "DRJIT_LIBLLVM_PATH", "DRJIT_LIBCUDA_PATH", "DRJIT_LIBOPTIX_PATH", "DRJIT_CACHE_DIR",
    "DRJIT_CACHE_MAXSIZE", "CUDA_VISIBLE_DEVICES", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS",
    "MPLBACKEND", "MPLCONFIGDIR", "TMPDIR", "XDG_CACHE_HOME", "PYTHONUTF8", "PYTHONIOENCODING", "PYTHONPATH", "LANG",
    "LC_ALL", "LC_CTYPE", "TERM", "COLUMNS", "NO_COLOR", "SLURM_CPUS_PER_TASK", "SLURM_MEM_PER_NODE",
)  # fmt: skip
LIMITS = {"AS": "addresses", "DATA": "data", "STACK": "stack", "FSIZE": "size of a file", "NOFILE": "open files"}

Facts = dict[str, Any]


def doctor() -> Facts:
    """What this machine is and whether it can render: section → facts, plain texts and numbers.

    `can_render` says whether a small kernel gave the right numbers on the backend of Dr.Jit that would be used; if not,
    `why_not` says what to do. The kernel runs in a process of its own, as a library that does not fit may abort it.
    The home folder is written as ~; the names of user and machine are not read.
    """
    tried = _kernels()
    facts: Facts = {
        "can_render": tried.pop("can_render"),
        "why_not": tried.pop("why_not", None),
        "hagoromo": {"version": __version__, "folder": str(Path(__file__).parents[2]), **_left_out()},
        "python": _python(),
        "system": {"platform": platform.platform(), "machine": platform.machine(), "container": _container()},
        "processor": {**_processor(), "kernel_threads": tried.pop("threads", None)},
        "memory": _memory(),
        "disk": {"here": _gib(shutil.disk_usage(".").free), "temporary": _gib(_free(tempfile.gettempdir()))},
        **tried,
        "kernel_cache": _kernel_cache(),
        "terminal": _terminal(),
        "environment": {name: os.environ[name] for name in ENVIRONMENT if name in os.environ},
        "libraries": _libraries(),
    }
    return _without_home(facts)


def doctor_page(facts: Facts) -> str:
    """The facts of `doctor` as one page of text."""
    lines = []
    for section, value in facts.items():
        if section == "libraries":
            lines += ["libraries", "  " + ", ".join(f"{name} {version}" for name, version in value.items())]
        elif isinstance(value, dict):
            lines += [section, *(f"  {name}: {_text(entry)}" for name, entry in value.items() if entry is not None)]
    verdict = "This machine can render." if facts["can_render"] else f"This machine cannot render: {facts['why_not']}"
    return "\n".join([*lines, "", verdict])


def _kernels() -> Facts:
    """What `try_kernels` says, which runs in another process."""
    from hagoromo.files.record import read_json

    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(path or os.getcwd() for path in sys.path)}
    with tempfile.TemporaryDirectory(prefix="hagoromo-doctor-") as folder:
        answer = Path(folder) / "answer.json"
        command = [sys.executable, "-P", "-m", "hagoromo.app.try_kernels", str(answer)]
        try:
            done = subprocess.run(
                command, env=environment, capture_output=True, stdin=subprocess.DEVNULL, timeout=WAIT_S, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            return {"can_render": False, "why_not": f"the process that tries the kernels failed: {error}"}
        facts: Facts = read_json(answer) if answer.exists() else {}
    if done.returncode or "can_render" not in facts:
        said = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:]
        facts["can_render"] = False
        facts["why_not"] = (
            f"the process that tries kernels ended with status {done.returncode} ({''.join(said) or 'no word why'}): "
            "try another libLLVM (DRJIT_LIBLLVM_PATH) or graphics driver, and report this page"
        )
    return facts


def _left_out() -> Facts:
    """Requirements of the package that are not installed."""
    absent = [name for name, version in _libraries().items() if version == "absent"]
    return {"missing": ", ".join(absent)} if absent else {}


def _libraries() -> dict[str, str]:
    """Version of each library that the package requires; extras only where they are installed."""
    from importlib.metadata import PackageNotFoundError, requires, version

    found = {}
    try:
        lines = requires("hagoromo") or []
    except PackageNotFoundError:
        return {}  # run from its source
    for line in lines:
        name = re.split(r"[^\w.-]", line, maxsplit=1)[0]
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            if "extra ==" not in line:
                found[name] = "absent"
    return dict(sorted(found.items(), key=lambda item: item[0].lower()))


def _python() -> Facts:
    return {
        "version": f"{platform.python_implementation()} {platform.python_version()}, {platform.architecture()[0]}",
        "executable": sys.executable,
        "environment": "virtual" if sys.prefix != sys.base_prefix else "of the system",
    }


def _container() -> str | None:
    """The kind of container that this process runs in, by its files."""
    for mark, kind in (("/.dockerenv", "Docker"), ("/run/.containerenv", "Podman"), ("/.singularity.d", "Apptainer")):
        if Path(mark).exists():
            return kind
    return None


def _processor() -> Facts:
    import psutil

    process: Any = psutil.Process()  # macOS does not list its processors
    usable = len(process.cpu_affinity() or ()) if hasattr(process, "cpu_affinity") else None
    share = _first_line(Path("/sys/fs/cgroup/cpu.max")).split()
    quota = float(share[0]) / float(share[1]) if len(share) == 2 and share[0] != "max" else None
    return {
        "name": _processor_name(),
        "cores": psutil.cpu_count(logical=False),
        "threads": psutil.cpu_count(),
        "threads_of_this_process": usable,
        "processors_by_control_group": quota,
    }


def _processor_name() -> str | None:
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8", errors="replace")
    except OSError:
        return platform.processor() or None
    names = [line.partition(":")[2].strip() for line in text.splitlines() if line.startswith("model name")]
    return names[0] if names else platform.processor() or None


def _memory() -> Facts:
    import psutil

    from hagoromo.files.memory import SHARE_OF_MEMORY, free_memory

    memory = psutil.virtual_memory()
    process: Any = psutil.Process()  # its limits are Linux's
    limits = []
    for name, title in LIMITS.items():
        if hasattr(process, "rlimit") and hasattr(psutil, f"RLIMIT_{name}"):
            soft = process.rlimit(getattr(psutil, f"RLIMIT_{name}"))[0]
            if 0 <= soft < 1 << 60:
                limits.append(f"{title} {soft if name == 'NOFILE' else _gib(soft)}")
    return {
        "physical": _gib(memory.total),
        "available": _gib(memory.available),
        "left_to_this_process": _gib(free_memory()),  # control groups and limits of the process counted
        "largest_array": _gib(SHARE_OF_MEMORY * free_memory()),
        "limits_of_the_process": ", ".join(limits) or None,
    }


def _kernel_cache() -> Facts:
    """The folder where Dr.Jit keeps compiled kernels, as its manual states it."""
    default = Path(tempfile.gettempdir()) / "drjit" if sys.platform == "win32" else Path.home() / ".drjit"
    folder = Path(os.environ.get("DRJIT_CACHE_DIR") or default)
    if not folder.is_dir():
        return {"folder": str(folder), "state": "absent: kernels are compiled anew in every process"}
    with os.scandir(folder) as entries:
        sizes = [entry.stat().st_size for entry in entries if entry.is_file()]
    state = "writable" if os.access(folder, os.W_OK) else "not writable: new kernels are compiled in every process"
    return {"folder": str(folder), "files": len(sizes), "size": _gib(sum(sizes)), "state": state}


def _terminal() -> Facts:
    encodings = {name: getattr(getattr(sys, name), "encoding", None) for name in ("stdin", "stdout", "stderr")}
    return {
        "is_terminal": bool(sys.stdout is not None and sys.stdout.isatty()),
        "columns": shutil.get_terminal_size().columns,
        **encodings,
        "encoding_of_the_system": locale.getpreferredencoding(False),
        "encoding_of_file_names": sys.getfilesystemencoding(),
    }


def _without_home(value: Any) -> Any:
    """A value with the home folder written as ~ in every text of it."""
    if isinstance(value, dict):
        return {name: _without_home(entry) for name, entry in value.items()}
    if isinstance(value, list):
        return [_without_home(entry) for entry in value]
    if not isinstance(value, str):
        return value
    flags = re.IGNORECASE if sys.platform == "win32" else 0
    for home in _homes():
        value = re.sub(re.escape(home) + r"(?![\w.-])", "~", value, flags=flags)
    return value


def _homes() -> Iterable[str]:
    """Names of the home folder, the longest first; none where it is the root of all folders."""
    try:
        given = Path.home()
    except RuntimeError:
        return ()  # no home is known
    names = {str(given), given.as_posix(), os.path.realpath(given)}
    return sorted((name for name in names if len(Path(name).parts) > 1), key=len, reverse=True)


def _first_line(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8", errors="replace").partition("\n")[0]
    except OSError:
        return ""


def _free(folder: str) -> float:
    try:
        return shutil.disk_usage(folder).free
    except OSError:
        return 0.0


def _gib(size: float) -> str:
    return f"{size / 2**30:.3g} GiB"


def _text(value: Any) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{name} {_text(entry)}" for name, entry in value.items())
    return value if isinstance(value, str) else json.dumps(value, ensure_ascii=False)
