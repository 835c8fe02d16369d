"""The command `hagoromo view`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from hagoromo.app.verb import say, verb, verbs

LOOPBACK = "127.0.0.1"


@verb(verbs)
def view(
    scene: Positional[Path],
    host: Annotated[str, arg(help="address to listen on; any but the default lets other machines in")] = LOOPBACK,
    port: Annotated[int, arg(help="port to listen on; 0: a free one")] = 0,
    against: Path | None = None,
) -> None:
    """Scene or volume box → a viewer in the browser: orbit it, relight it, edit it, and write what was found.

    It goes on until Ctrl-C. The address that it prints holds a token, without which nobody is let in.

    Args:
        scene: SCENE.toml or BOX.zarr.
        against: capture whose photographs the picture is held against, or a file of cameras to jump to.
    """
    from hagoromo.view.browser import Browser
    from hagoromo.view.photographs import photographs_of
    from hagoromo.view.scene_files import opened
    from hagoromo.view.watcher import Desk

    photographs = [] if against is None else photographs_of(against)
    browser = Browser(Desk(*opened(scene), photographs), host, port)
    try:
        say(f"open {browser.address}")
        browser.run()
    finally:
        browser.stop()
