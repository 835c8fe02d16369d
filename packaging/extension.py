"""The extension for Blender as a zip, which Blender installs from the disk: `make blender`.

    python packaging/extension.py out/package

Writes hagoromo_blender-VERSION.zip into the folder, the files of hagoromo_blender at its top, and prints its path.
"""

from __future__ import annotations

import sys
import tomllib
import zipfile
from pathlib import Path

HOME = Path(__file__).resolve().parents[1] / "hagoromo_blender"
EARLIEST = (1980, 1, 1, 0, 0, 0)  # the time of every file, so that the zip is the same each time


def main(folder: str) -> int:
    """Write the zip."""
    version = tomllib.loads((HOME / "blender_manifest.toml").read_text(encoding="utf-8"))["version"]
    archive = Path(folder) / f"hagoromo_blender-{version}.zip"
    archive.parent.mkdir(parents=True, exist_ok=True)
    with zipfile.ZipFile(archive, "w", zipfile.ZIP_DEFLATED) as held:
        for file in sorted(path for path in HOME.iterdir() if path.is_file()):
            held.writestr(zipfile.ZipInfo(file.name, EARLIEST), file.read_bytes())
    print(archive)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
