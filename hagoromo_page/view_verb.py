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
    """Scene, volume box, capture, measurement or image → a viewer in the browser: to orbit, relight, edit and probe.

    It goes on until Ctrl-C. The address that it prints holds a token, without which nobody has access.

    Args:
        scene: SCENE.toml, BOX.zarr, the folder of a capture or one that `measure` wrote, or IMAGE.exr with weights or
            spectra.
        against: capture whose photographs the picture of a scene is held against, or a file of cameras to jump to.
    """
    from hagoromo_page.viewer.browser import Browser
    from hagoromo_page.viewer.open_desk import open_desk

    browser = Browser(open_desk(scene, against), host, port)
    try:
        say(f"open {browser.address}")
        browser.run()
    finally:
        browser.stop()
