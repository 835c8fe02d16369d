"""Start of the command `hagoromo`: signals are heard before the package and what it needs are loaded.

It is a package of its own because importing `hagoromo` takes longer than what is here.
"""

import os
import signal
import sys

NAMES = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")  # of signals that ask a process to end; a system has some of them


def _stop(number: int, _frame: object) -> None:
    """End at once: nothing has been written yet."""
    os.write(2, b"hagoromo: interrupted: nothing was written\n")
    os._exit(128 + number)


def main() -> int:
    """Run the command line of this process; returns the exit status, or ends the process if it was interrupted."""
    for number in (getattr(signal, name) for name in NAMES if hasattr(signal, name)):
        if signal.getsignal(number) is not signal.SIG_IGN:  # as nohup and background jobs want
            signal.signal(number, _stop)
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
