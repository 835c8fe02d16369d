"""The command `hagoromo export`."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote
from hagoromo.files.names import printable

SOME_REFUSED = 2  # exit status


@verb(verbs)
def export(
    measured: Positional[Path],
    to: Annotated[tuple[str, ...], arg(name="to")],
    out: Out,
    capture: Path | None = None,
    force: Force = False,
) -> int | None:
    """Measured object → files that other programs read; export.json and the output say what each of them loses.

    Args:
        measured: folder that `measure` wrote, or a materials.json (of `fit`, too) for materialx, openpbr and rgl.
        to: formats: png, tiff, exr (normals, albedo, roughness, depth); glb, ply (mesh); relightable images: ptm, hsh
            (object.rti), rti (both of these), relight (OpenLIME); csv (spectra); materialx (standard_surface),
            openpbr (MaterialX, too); rgl (a .bsdf for each material, read by Mitsuba, with covariance.json);
            openmaterial (ASAM OpenMATERIAL 3D: .xomp and tables by wavelength and angle). One that cannot be written is
            named, the others are written, and the exit status is 2.
        capture: folder that was measured, for a measurement of version 0.2.
    """
    from hagoromo_formats.relightable.materialx import differences

    with progress_bar("export") as progress:
        record = hg.export(measured, to, out, capture=capture, force=force, progress=progress)
    for name, loss in record["formats"].items():
        error, files = loss.get("rms_error_before_quantisation"), loss.get("files") or [loss.get("file")]
        head = name if files[0] is None else f"{name} ({', '.join(files)})"
        say(f"{head}: lost: {loss['lost']}" + ("" if error is None else f"; rms error {100 * error:.1f} % of white"))
        for material, off in loss.get("relative_difference", {}).items():
            say(f"{name}: material {material!r}: {differences(off)}")
        say(*(f"{name}: lost of {each}" for each in loss["lost_of_materials"]))
    wrote(out / "export.json")
    for why in record["refused"].values():
        print(f"hagoromo: not written: {printable(why)}", file=sys.stderr)
    return SOME_REFUSED if record["refused"] else None
