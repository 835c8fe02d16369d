"""Caches: where Dr.Jit and Matplotlib keep files between runs, if the home of the user cannot hold them.

Services and containers often have no home, or one that cannot be written. Both libraries then print lines of their own
and compile or look for fonts anew at every start. They get a folder among the temporary files, which only its user can
read or write: kernels are code.
"""

import os
import stat


def find_caches() -> None:
    """Set HOME, DRJIT_CACHE_DIR and MPLCONFIGDIR where what they are now leads to no folder that can be written."""
    if os.name != "posix":
        return
    home = os.path.expanduser("~")  # without HOME: from the list of users
    os.environ["HOME"] = home if os.path.isabs(home) else "/nonexistent"
    lacking = [name for name, folders in _wanted().items() if not all(map(_can_be_written, folders))]
    own = _own_folder() if lacking else ""
    for name in lacking if own else ():
        os.environ[name] = os.path.join(own, name.lower())


def _wanted() -> dict[str, list[str]]:
    """The folders that each library uses now, by the variable that names another one."""
    given, home = os.environ.get, os.environ["HOME"]
    fonts = [given(f"XDG_{kind}_HOME") or os.path.join(home, f".{kind.lower()}") for kind in ("CONFIG", "CACHE")]
    return {
        "DRJIT_CACHE_DIR": [given("DRJIT_CACHE_DIR") or os.path.join(home, ".drjit")],
        "MPLCONFIGDIR": [given("MPLCONFIGDIR", "")] if given("MPLCONFIGDIR") else fonts,
    }


def _can_be_written(folder: str) -> bool:
    """Whether files can be made in a folder, or the folder where there is none."""
    folder = os.path.abspath(folder)
    while not os.path.lexists(folder):
        folder = os.path.dirname(folder)
    return os.path.isdir(folder) and os.access(folder, os.W_OK | os.X_OK)


def _own_folder() -> str:
    """A folder among the temporary files that is this user's alone; "" if there cannot be one."""
    import tempfile

    user = os.getuid() if os.name == "posix" else 0
    try:
        path = os.path.join(tempfile.gettempdir(), f"hagoromo-{user}")
        try:
            os.mkdir(path, 0o700)
        except FileExistsError:
            pass
        found = os.lstat(path)
    except OSError:
        return ""
    is_own = stat.S_ISDIR(found.st_mode) and found.st_uid == user and not found.st_mode & 0o077
    return path if is_own else ""
