"""The commands that serve the browser: `hagoromo view` and `hagoromo lab`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

from hagoromo.app.verb import say, show_in_browser, verb, verbs

LOOPBACK = "127.0.0.1"


@verb(verbs)
def view(
    scene: Positional[Path],
    host: Annotated[str, arg(help="address to listen on; any but the default lets other machines in")] = LOOPBACK,
    port: Annotated[int, arg(help="port to listen on; 0: a free one")] = 0,
    against: Path | None = None,
    ocio: str | None = None,
) -> None:
    """Scene, volume box, capture, measurement or image → a viewer in the browser: to orbit, relight, edit and probe.

    It goes on until Ctrl-C. The address that it prints holds a token, without which nobody has access.

    Args:
        scene: SCENE.toml, BOX.zarr, the folder of a capture or one that `measure` wrote, or IMAGE.exr with weights or
            spectra.
        ocio: configuration of OpenColorIO, a file or ocio://NAME, whose views are among the tone curves (default: those
            of ACES 2.0, where OpenColorIO is installed).
        against: capture whose photographs the picture of a scene is held against, or a file of cameras to jump to.
    """
    from hagoromo_page.viewer.browser import Browser
    from hagoromo_page.viewer.open_desk import open_desk

    browser = Browser(open_desk(scene, against, ocio), host, port)
    try:
        say(f"open {browser.address}")
        browser.run()
    finally:
        browser.stop()


@verb(verbs)
def lab(
    folder: Positional[Path] = Path("."),
    port: Annotated[int, arg(help="port to listen on; 0: a free one")] = 0,
    no_browser: Annotated[bool, arg(help="only print the address, and open no browser")] = False,
) -> None:
    """Folder of photographs → a window in the browser: from the photographs to the published page, step by step.

    Every step is a command that the window shows and runs. It goes on until Ctrl-C. The address that it prints holds a
    token, without which nobody has access; it is for this machine alone.

    Args:
        folder: what the window shows, and nothing outside of it: the photographs, or a folder of such folders.
    """
    from hagoromo_page.lab.laboratory import Laboratory
    from hagoromo_page.lab.server import LabServer

    server = LabServer(Laboratory(folder), port)
    try:
        say(f"open {server.address}")
        if sys.stdout is not None:  # it is not, where no console is
            sys.stdout.flush()
        if not no_browser:
            show_in_browser(server.address)
        server.serve_forever()
    finally:
        server.stop()
