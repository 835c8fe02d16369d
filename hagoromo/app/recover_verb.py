"""The command `hagoromo recover`."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, Written, say, verb, verbs, wrote
from hagoromo.errors import InputError
from hagoromo.files.record import write_json
from hagoromo.files.whole import replaceable_files, replaceable_folder, whole_files
from hagoromo.recovery.choices import Light, Refine


def recovery_files(out: Path) -> Written:
    """What `recover` writes: the box, the mesh, what was found, and a report."""
    return Written((out, *(out.with_suffix(suffix) for suffix in (".ply", ".json", ".html"))))


@verb(verbs, writes=recovery_files)
def recover(
    capture: Positional[Path],
    out: Out,
    side: int = 128,
    steps: int = 80,
    keep: int = 8,
    shadows: bool = True,
    voxels: int | None = None,
    seed: int = 0,
    light: Light = "auto",
    refine: Refine = "auto",
    force: Force = False,
) -> None:
    """Photographs of many views and lamps → a volume box of the object; its mesh, figures and a report beside it.

    The result is BOX.zarr (--out), BOX.ply, BOX.json and BOX.html. Ctrl-C ends the work early and writes what
    there is, with exit status 130.

    Args:
        capture: folder with transforms.json: a camera and a lamp, or several, for each photograph. Without lamps they
            are photographs of fixed unknown light: the light that the surface sends out stands for its colour.
        side: nodes of the lattice along the object's longest edge, on which it is recovered.
        steps: of each level of the lattice, from coarse to fine.
        keep: every how many photographs one is kept aside, to be predicted; 0: none.
        shadows: whether the object's shadows on itself are taken into account.
        voxels: of the box along its longest edge (default: three a node, up to 768).
        seed: of the pixels that are drawn.
        light: of photographs without lamps, what it is fixed to: the object; the camera (lamps move with it, or the
            object turns before it); even: the object, and body colours alone hold it. auto tries all three and takes
            the one that predicts best.
        refine: cameras: one small turn of all cameras together is estimated, as of a principal point that is some
            pixels wrong. auto: where no lamps are known, if it predicts better.
    """
    if out.suffix != ".zarr":
        raise InputError(f"{out} is no name of a volume box: give one that ends in .zarr")
    box, *beside = recovery_files(out).files
    replaceable_folder(box, force)
    replaceable_files(beside, force)
    settings = hg.RecoverySettings(
        side=side, steps=steps, keep=keep, shadows=shadows, seed=seed, light=light, refine=refine
    )
    with progress_bar("recover") as progress:
        recovered = hg.recover(capture, settings, progress)
    made, mesh, record = recovered.box(voxels), recovered.mesh(), recovered.record()
    with whole_files(beside, force) as (mesh_file, record_file, page):
        mesh.save(mesh_file)
        write_json(record_file, record)
        hg.write_recovery_report(page, recovered, record)
        made.save(box, force)
    for line in summary(record):
        say(line)
    if not recovered.complete:
        raise KeyboardInterrupt(f"{box} and what stands beside it are what there was by then")
    wrote(box, *beside)


def summary(record: dict[str, Any]) -> list[str]:
    """What is said of a recovery."""
    lines = [f"{record['photographs']} photographs, nodes of {1e3 * record['voxel_m']:.3g} mm"]
    if material := record["material"]:
        known = [key for key, is_known in material["identifiable"].items() if is_known]
        found = ", ".join(f"{key} {material[key]:.3g}" for key in ("beta", "gamma", "n"))
        lines.append(f"gloss: {found}; identifiable: {', '.join(known) or 'nothing'}")
    if record["material"] is None:
        lines.append(f"light {record['lamps']}; cameras: {record['cameras']}")
    for score in record["kept_aside"]:
        lines.append(f"{score['name']}, kept aside: {score['psnr']:.2f} dB, {score['inside']:.2f} dB in its silhouette")
    return lines
