"""The command as a user starts it, who may interrupt it."""

# the command; a suite that was started in the background would hand on that it ignores Ctrl-C
STARTED = """
import signal
for name in ("SIGINT", "SIGTERM", "SIGHUP"):
    signal.signal(getattr(signal, name), signal.SIG_DFL)
signal.signal(signal.SIGINT, signal.default_int_handler)
from hagoromo_start import main
raise SystemExit(main())
"""
