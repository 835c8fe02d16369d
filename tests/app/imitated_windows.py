"""The command line where Windows' limits are imitated:
`python tests/app/imitated_windows.py '[["info", "box.zarr"], ["--help"]]'`.

What Windows lacks is taken away (modules, names of `os` and `signal`), `sys.platform` says win32, standard output has
the code page 1252, and files that are open or mapped can neither be moved, replaced nor removed. Libraries are
loaded before and stay those of the system at hand, as does the form of paths.
"""

from __future__ import annotations

import errno
import importlib
import io
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

# what Windows lacks: modules, and names of modules that it has
MODULES = {"crypt", "curses", "fcntl", "grp", "nis", "posix", "pty", "pwd", "readline", "resource", "spwd", "syslog"}
MODULES |= {"termios", "tty"}
NAMES = {
    "os": {
        "chown", "chroot", "confstr", "fchdir", "fchown", "fork", "forkpty", "getegid", "geteuid", "getgid",
        "getgroups", "getloadavg", "getpgid", "getpgrp", "getpriority", "getsid", "getuid", "killpg", "lchown",
        "mkfifo", "mknod", "nice", "openpty", "pathconf", "posix_fadvise", "posix_fallocate", "posix_spawn", "pread",
        "preadv", "pwrite", "pwritev", "sched_getaffinity", "sched_setaffinity", "sched_yield", "sendfile", "setegid",
        "seteuid", "setgid", "setpgid", "setsid", "setuid", "statvfs", "fstatvfs", "sync", "sysconf", "sysconf_names",
        "uname", "wait3", "wait4", "waitid", "WIFEXITED", "WIFSIGNALED", "WTERMSIG", "WNOHANG", "O_DIRECTORY",
        "O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_SYNC", "O_TMPFILE", "renameat2",
    },
    "signal": {
        "SIGALRM", "SIGCHLD", "SIGCONT", "SIGHUP", "SIGKILL", "SIGPIPE", "SIGQUIT", "SIGSTOP", "SIGTSTP", "SIGUSR1",
        "SIGUSR2", "alarm", "pause", "pthread_kill", "pthread_sigmask", "setitimer", "siginterrupt", "sigpending",
        "sigtimedwait", "sigwait",
    },
    "select": {"poll", "epoll", "kqueue"},
    "socket": {"AF_UNIX"},
    "time": {"tzset", "clock_gettime", "pthread_getcpuclockid"},
    "asyncio": {"add_signal_handler"},
}  # fmt: skip

LIBRARIES = """asyncio cv2 colour colour_demosaicing drjit filelock jinja2 lazy_loader matplotlib.pyplot mitsuba msgspec
multiprocessing numpy OpenEXR platformdirs psutil rawpy rich.console rich.progress scipy.ndimage scipy.optimize
scipy.sparse.linalg skimage.metrics subprocess tempfile tifffile trimesh tyro zarr zarr.storage concurrent.futures
drjit.llvm.ad drjit.detail ctypes.util uuid""".split()


def imitate() -> None:
    """Take away what Windows lacks."""
    assert not any(name.partition(".")[0].startswith("hagoromo") for name in sys.modules)  # they would keep it
    for library in LIBRARIES:
        importlib.import_module(library)
    import filelock
    import mitsuba

    _ = filelock.FileLock, filelock.SoftFileLock, filelock.Timeout  # loaded on first use
    mitsuba.set_variant("llvm_ad_rgb")
    for name in MODULES:
        sys.modules[name] = None  # type: ignore[assignment]  # an import of it raises ImportError
    shutil._use_fd_functions = False  # type: ignore[attr-defined]
    for name in ("unlink", "remove", "rmdir"):
        setattr(os, name, held_back(getattr(os, name), 1))
    os.replace = held_back(os.replace, 2)
    os.rename = held_back(refuse_existing(os.rename), 2)
    for module, gone in NAMES.items():
        sys.modules[module] = without(importlib.import_module(module), gone)
    sys.modules["os"].name = "nt"  # type: ignore[attr-defined]
    sys.platform = "win32"
    for name in ("stdout", "stderr"):
        raw: Any = getattr(sys, name).buffer
        setattr(sys, name, io.TextIOWrapper(raw, encoding="cp1252", errors="strict", line_buffering=True))


def without(module: ModuleType, gone: set[str]) -> ModuleType:
    """What imports of `module` give from now on: a copy without the names `gone`. Libraries have the module itself."""
    copy = ModuleType(module.__name__, module.__doc__)
    vars(copy).update({name: value for name, value in vars(module).items() if name not in gone})
    return copy


def held_back(function: Callable[..., Any], paths: int) -> Callable[..., Any]:
    """`function`, which Windows refuses while one of its first `paths` arguments, or a file below it, is open."""

    def guarded(*arguments: Any, **named: Any) -> Any:
        for path in arguments[:paths]:
            if (held := first_open(os.path.realpath(os.fsdecode(path)))) is not None:
                raise PermissionError(errno.EACCES, f"imitated Windows: {held} is open", os.fsdecode(path))
        return function(*arguments, **named)

    return guarded


def refuse_existing(function: Callable[..., Any]) -> Callable[..., Any]:
    """`os.rename` of Windows, which replaces nothing."""

    def guarded(source: Any, target: Any, **named: Any) -> Any:
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, "imitated Windows: the target exists", os.fsdecode(target))
        return function(source, target, **named)

    return guarded


def first_open(path: str) -> str | None:
    """A file at or below `path` that this process has open or mapped."""
    for descriptor in os.listdir("/proc/self/fd"):
        try:
            file = os.readlink(f"/proc/self/fd/{descriptor}")
        except OSError:
            continue  # that of the folder itself
        if file == path or file.startswith(path + "/"):
            return file
    with open("/proc/self/maps", encoding="utf-8", errors="surrogateescape") as maps:
        mapped = [line.split(maxsplit=5)[5].rstrip("\n") for line in maps if line.count("/")]
    return next((file for file in mapped if file == path or file.startswith(path + "/")), None)


if __name__ == "__main__":
    sys.path.insert(0, str(Path(__file__).parents[2]))
    imitate()
    assert not hasattr(importlib.import_module("os"), "fork") and sys.stdout.encoding == "cp1252"
    from hagoromo.app.cli import main

    for arguments in json.loads(sys.argv[1]):
        try:
            status = main(arguments)
        except SystemExit as end:  # --help
            status = end.code
        print(f"status {status}", flush=True)
