"""The signals that ask a process to end."""

import signal


def stopping_signals() -> list[signal.Signals]:
    """The signals of this system that ask a process to end."""
    names = ("SIGINT", "SIGTERM", "SIGHUP", "SIGBREAK")
    return [getattr(signal, name) for name in names if hasattr(signal, name)]
