"""The signals that ask a process to end."""

import signal


def stopping_signals() -> list[signal.Signals]:
    """The signals that ask a process to end, as far as the system has them."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    return [getattr(signal, name) for name in names if hasattr(signal, name)]
