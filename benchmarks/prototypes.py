"""The throw-away prototypes in ../shared/prototypes, where present: what was known to be possible before the product.

They run in a temporary folder, for they write beside themselves.
"""

from __future__ import annotations

import os
import shutil
import sys
import tempfile
from pathlib import Path
from typing import Any

import drjit as dr
import numpy as np
from turns import Frame

from hagoromo.backend import name as backend_name

PROTOTYPES = Path(__file__).resolve().parents[2] / "shared" / "prototypes"


def prototype_frames() -> dict[str, Frame]:
    """Their best frames: distance skipping, halves, tiles; then with three maps of 512², 32 slices, made anew."""
    if not (PROTOTYPES / "q2.py").exists() or backend_name() != "llvm":
        print(f"prototypes: not here ({PROTOTYPES.name} absent, or another backend than llvm), left out")
        return {}
    here = Path.cwd()
    with tempfile.TemporaryDirectory() as folder:
        for script in PROTOTYPES.glob("*.py"):
            shutil.copy(script, folder)
        os.chdir(folder)
        sys.path.insert(0, folder)
        sys.argv = sys.argv[:1]  # the scripts read theirs when they are imported
        try:
            import mkgrid

            np.save("vox256.npy", mkgrid.make(256))
            import q2
        finally:
            os.chdir(here)

    def mapped() -> Any:
        maps = [q2.dsm_one(lamp, 512, 32, q2.STEP, 10.0) for lamp in q2.Ls]
        dr.eval(maps)
        return q2.render(q2.sh_dsm(maps, 512, 32))

    return {"prototype, no shadows": lambda: q2.render(q2.sh_none), "prototype, maps 512² made anew": mapped}
