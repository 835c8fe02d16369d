"""Start of the command `hagoromo`: signals are heard before the package and what it needs are loaded.

It is a package of its own because importing `hagoromo` takes longer than what is here.
"""

import importlib.util
import os
import re
import signal
import sys

from hagoromo_start.caches import find_caches
from hagoromo_start.stopping_signals import stopping_signals

LEAST_MEMORY, PER_CORE = 600 * 2**20, 72 * 2**20  # bytes of addresses: of libraries, and of a thread of each of them

NUMBERS = re.compile(r"SOURCE_DATE_EPOCH|OPENCV_(IO_MAX_IMAGE_|THREAD_POOL_ACTIVE_WAIT_)\w+|OPENCV_FOR_THREADS_NUM")


def _lack_of_memory() -> str:
    """A line where the limits of the process (`ulimit -v`, `ulimit -d`) do not let its libraries load; else nothing.

    Some of them end the process where they get no memory, or wait for ever.
    """
    if importlib.util.find_spec("resource") is None:
        return ""  # Windows
    resource = importlib.import_module("resource")
    limits = [resource.getrlimit(getattr(resource, name))[0] for name in ("RLIMIT_AS", "RLIMIT_DATA")]
    allowed = min((limit for limit in limits if limit != resource.RLIM_INFINITY), default=None)
    needed = LEAST_MEMORY + PER_CORE * (os.cpu_count() or 1)
    if allowed is None or allowed >= needed:
        return ""
    return (
        f"hagoromo: the program needs {needed / 2**30:.2f} GiB of memory to start and may take "
        f"{allowed / 2**30:.2f} GiB: allow it more (ulimit -v, ulimit -d)"
    )


def _wrong_number() -> str:
    """A line where a variable of the environment is no number that a library ends the process over; else nothing.

    OpenCV aborts at its first picture; NumPy, which only wants to know when it was compiled, raises an error.
    """
    for name, value in os.environ.items():
        unit = "([KM]B|[KkMm]b)?" if name.startswith("OPENCV") else ""
        if NUMBERS.fullmatch(name) and not re.fullmatch(r"[0-9]{1,18}" + unit, value):
            return f"hagoromo: {name} is {value[:40]!r} in the environment: give a whole number, or unset it"
    return ""


def _stop(number: int, _frame: object) -> None:
    """End at once: nothing has been written yet."""
    os.write(2, b"hagoromo: interrupted: nothing was written\n")
    os._exit(128 + number)


def main() -> int:
    """Run the command line of this process; returns the exit status, or ends the process if it was interrupted."""
    for number in stopping_signals():
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup and background jobs want
            signal.signal(number, _stop)
    os.environ["MPLBACKEND"] = "Agg"  # no window is opened; a notebook's commands inherit a backend that may be missing
    find_caches()
    lack = _lack_of_memory() if sys.platform == "linux" else ""  # macOS does not heed its limits
    if wrong := lack or _wrong_number():
        print(wrong, file=sys.stderr)
        return 2
    from hagoromo.app.cli import main as run

    status = run(ends=True)
    if status > 128:  # ended by a signal: what still runs in threads need not come to an end
        for stream in (sys.stdout, sys.stderr):
            try:
                stream.flush()
            except (AttributeError, OSError, ValueError):
                pass  # closed
        os._exit(status)
    return status
