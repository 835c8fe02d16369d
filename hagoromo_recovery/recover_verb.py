"""The command `hagoromo recover`."""

from __future__ import annotations

from math import degrees
from pathlib import Path
from typing import Any

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.shared_options import HERE, Scheduler
from hagoromo.app.verb import Force, Out, Written, say, verb, verbs, wrote
from hagoromo.errors import InputError
from hagoromo.files.record import write_json
from hagoromo.files.whole import replaceable_files, replaceable_folder, whole_files
from hagoromo_recovery.choices import AUTO, GlossChoice, Light, MatterChoice, OrdersChoice


def recovery_files(out: Path) -> Written:
    """What `recover` writes: the box, the mesh, what was found, and a report."""
    return Written((out, *(out.with_suffix(suffix) for suffix in (".ply", ".json", ".html"))))


@verb(verbs, writes=recovery_files)
def recover(
    capture: Positional[Path],
    out: Out,
    side: int = 128,
    steps: int = 200,
    keep: int = 8,
    shadows: bool = True,
    errors: bool = True,
    voxels: int | None = None,
    seed: int = 0,
    light: Light = "auto",
    refine: str = AUTO,
    matter: MatterChoice = "surface",
    gloss: GlossChoice = "one",
    orders: OrdersChoice = "first",
    resume: bool = False,
    scheduler: Scheduler = HERE,
    force: Force = False,
) -> None:
    """Photographs of many views and lamps → a volume box of the object; its mesh, figures and a report beside it.

    The result is BOX.zarr (--out), BOX.ply, BOX.json and BOX.html. Ctrl-C ends the work early and writes what
    there is, with exit status 130. Until the work is done, BOX.checkpoint.npz holds it: --resume goes on from there.

    Args:
        capture: folder with transforms.json: a camera and a lamp, or several, for each photograph. Without lamps they
            are photographs of fixed unknown light: the light that the surface sends out stands for its colour.
        side: nodes of the lattice along the object's longest edge, on which it is recovered.
        steps: of each level of the lattice, from coarse to fine.
        keep: every how many photographs one is kept aside, to be predicted; 0: none.
        shadows: whether the object's shadows on itself are taken into account.
        errors: whether each half of the photographs gives an object of its own, too, so that the errors of places are
            known: that doubles the time.
        voxels: of the box along its longest edge (default: five a node, up to 768; of fuzzy matter one a node).
        seed: of the pixels that are drawn.
        light: of photographs without lamps, what it is fixed to: the object; the camera (lamps move with it, or the
            object turns before it); even: the object, and body colours alone hold it. auto tries all three and takes
            the one that predicts best.
        refine: what is estimated beside the object, a list such as cameras,lamps: turn: one small turn of all cameras
            together, as of a principal point that is some pixels wrong; cameras: a small turn and shift of each;
            lamps: a factor on the strength of each; exposure: a factor on each photograph; places: a shift of each
            lamp; masks: their outlines are moved to where photographs show them. none: nothing. auto: masks, and a
            turn, where no lamps are known, if it predicts better.
        matter: surface; fuzzy: fibres without a surface, such as fur and down, a free density with axes and colours of
            its own; auto tries both on a coarse lattice and takes the one that predicts better.
        gloss: of a surface under known lamps. one: the whole object has one; places: it has two, and each place has
            shares of both, so that β and γ differ from place to place; auto tries both on a coarse lattice and takes
            places if that predicts better.
        orders: of light, of a surface under known lamps. first: that of lamps alone; all: also from one part of the
            object to another, for white objects and hollows; auto tries both on a coarse lattice and takes all if that
            predicts better.
        resume: go on from BOX.checkpoint.npz, with the same capture and options. The result has the same bits.
        scheduler: its workers take the pixels of each step; the result has the same bits.
    """
    if out.suffix != ".zarr":
        raise InputError(f"{out} is no name of a volume box: give one that ends in .zarr")
    box, *beside = recovery_files(out).files
    checkpoint = out.with_suffix(".checkpoint.npz")
    _check_begun(checkpoint, resume, force)
    force = force or resume  # what is there is of the same work
    replaceable_folder(box, force)
    replaceable_files(beside, force)
    settings = hg.RecoverySettings(
        side=side,
        steps=steps,
        keep=keep,
        shadows=shadows,
        errors=errors,
        seed=seed,
        light=light,
        refine=refine,
        matter=matter,
        gloss=gloss,
        orders=orders,
    )
    if not resume:
        checkpoint.unlink(missing_ok=True)
    with progress_bar("recover") as progress:
        recovered = hg.recover(capture, settings, progress, checkpoint, scheduler.chosen)
    made, mesh, record = recovered.box(voxels), recovered.mesh(), recovered.record()
    with whole_files(beside, force) as (mesh_file, record_file, page):
        mesh.save(mesh_file)
        write_json(record_file, record)
        hg.write_recovery_report(page, recovered, record)
        made.save(box, force)
    for line in summary(record):
        say(line)
    if not recovered.complete:
        raise KeyboardInterrupt(f"{box} and what stands beside it are what there was by then; --resume goes on")
    wrote(box, *beside)


def _check_begun(checkpoint: Path, resume: bool, force: bool) -> None:
    """`InputError` where there is no work to resume, or where there is some that nobody asked to start anew."""
    if resume and not checkpoint.exists():
        raise InputError(f"there is no {checkpoint} to go on from: leave --resume out")
    if checkpoint.exists() and not (resume or force):
        raise InputError(f"{checkpoint} holds unfinished work: give --resume to go on, or --force to start anew")


def _of_hollow(hollow: dict[str, float]) -> str:
    less = 100.0 * (1.0 - hollow["left_over"])
    return f"hollow: one with a wall of {1e3 * hollow['wall_m']:.2g} mm left {less:.0f} % less unexplained than a dent"


def summary(record: dict[str, Any]) -> list[str]:
    """What is said of a recovery."""
    lines = [f"{record['photographs']} photographs, nodes of {1e3 * record['voxel_m']:.3g} mm"]
    if tried := record["matter_tried_db"]:
        lines.append(f"matter {record['matter']}; tried: " + ", ".join(f"{k} {db:.2f} dB" for k, db in tried.items()))
    for material in record["materials"]:
        known = [key for key, is_known in material["identifiable"].items() if is_known]
        if material["beta"] == 0.0:
            lines.append(f"gloss: none was found; beta is below {material['interval_95']['beta'][1]:.2g}")
            continue
        found = ", ".join(f"{key} {material[key]:.3g}" for key in ("beta", "gamma", "n"))
        lines.append(f"gloss: {found}; identifiable: {', '.join(known) or 'nothing'}")
    if tried := record["gloss_tried_db"]:
        lines.append("gloss tried: " + ", ".join(f"{k} {db:.2f} dB" for k, db in tried.items()))
    if tried := record["orders_tried_db"]:
        lines.append(f"orders {record['orders']}; tried: " + ", ".join(f"{k} {db:.2f} dB" for k, db in tried.items()))
    if hollow := record["hollow"]:
        lines.append(_of_hollow(hollow))
    if places := record["gloss"]:
        low, high = ([places[key][k] for key in ("beta", "gamma")] for k in (0, -1))
        lines.append(
            f"gloss of places, 5 to 95 %: beta {low[0]:.3g} to {high[0]:.3g}, gamma {low[1]:.3g} to {high[1]:.3g}"
        )
    if record["material"] is None:
        lines.append(f"light {record['lamps']}; cameras: {record['cameras']}")
    if (errors := record["errors"]) and errors["position_m"]:
        position, normal = errors["position_m"][0], errors["normal_rad"][0]
        lines.append(f"standard errors, median: position {1e6 * position:.3g} µm, normal {degrees(normal):.2g}°")
    for score in record["kept_aside"]:
        lines.append(f"{score['name']}, kept aside: {score['psnr']:.2f} dB, {score['inside']:.2f} dB in its silhouette")
    return [*lines, *(f"remark: {said}" for said in record["remarks"])]
