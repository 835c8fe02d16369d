"""Start of the command `hagoromo`: signals are heard before the package and what it needs are loaded.

It is a package of its own because importing `hagoromo` takes longer than what is here.
"""

import importlib.util
import os
import signal
import sys

LEAST_MEMORY, PER_CORE = 600 * 2**20, 72 * 2**20  # bytes of addresses: of libraries, and of a thread of each of them


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


def stopping_signals() -> list[signal.Signals]:
    """The signals that ask a process to end, as far as the system has them."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    return [getattr(signal, name) for name in names if hasattr(signal, name)]


def _stop(number: int, _frame: object) -> None:
    """End at once: nothing has been written yet."""
    os.write(2, b"hagoromo: interrupted: nothing was written\n")
    os._exit(128 + number)


def main() -> int:
    """Run the command line of this process; returns the exit status, or ends the process if it was interrupted."""
    for number in stopping_signals():
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup and background jobs want
            signal.signal(number, _stop)
    lack = _lack_of_memory() if sys.platform == "linux" else ""  # macOS does not heed its limits
    if lack:
        print(lack, file=sys.stderr)
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
