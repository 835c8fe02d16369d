"""The picture of the how-to on the laboratory: its window in Chromium, after the photographs of a dome were checked.

    python -m studies.laboratory --out out/laboratory

Leaves: lab.jpg, and the simulated photographs that it shows.
"""

from __future__ import annotations

import shutil
import threading
from pathlib import Path

import hagoromo as hg
from hagoromo_page.lab.laboratory import Laboratory
from hagoromo_page.lab.server import LabServer
from studies.chromium import chromium_page
from studies.command import command
from studies.dome import dome

WINDOW = 1400, 900  # px
QUALITY = 84
LAMPS, WIDTH = 24, 720
PATIENCE_MS = 600_000.0


def laboratory(out: str | Path, force: bool = False) -> None:
    """The picture in the folder `out`."""
    with hg.whole_folder(out, force) as home:
        made = dome(home / "made", LAMPS, WIDTH)
        shutil.move(made / "photographs", home / "Vase 12")
        shutil.rmtree(made)
        server = LabServer(Laboratory(home))
        serving = threading.Thread(target=server.serve_forever, args=(0.05,), daemon=True)
        serving.start()
        try:
            _look(server.address, home / "lab.jpg")
        finally:
            server.shutdown()
            server.stop()
            serving.join()


def _look(address: str, picture: Path) -> None:
    """Choose the folder, check its photographs, and take the picture."""
    with chromium_page(address, WINDOW) as page:
        page.click(".folders button")
        page.click("#next")
        page.click("#run-health")
        page.wait_for_selector("#running", state="visible")
        page.wait_for_selector("#running", state="hidden", timeout=PATIENCE_MS)
        page.click("#strip button >> nth=13")
        page.click("#tool-look")
        page.wait_for_load_state("networkidle")
        page.screenshot(path=picture, type="jpeg", quality=QUALITY)


def main(out: Path, force: bool = False) -> None:
    """Write the picture.

    Args:
        out: where to write the result.
        force: replace an existing result.
    """
    laboratory(out, force)


if __name__ == "__main__":
    command(main)
