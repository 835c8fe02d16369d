"""A real object as a film and as a page: recovered from photographs under light that nobody measured, lit by new lamps.

    python -m studies.real_object --data FOLDER --out out/real_object [--capture dino_48] [--side 64]

It writes the box and its figures, `turning.gif` (the object turns before a lamp that stands still), `lamp.gif`
(a lamp goes round it), and `page.html`, where the lamp is moved by hand. `hagoromo view` opens the box in the viewer.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from studies.real_captures import REAL

Array = NDArray[np.float64]
WIDTH, FILLED = 320, 0.42  # px of a frame; of which the object's radius takes that share
SCENE = """\
[camera]
size = [{width}, {width}]
focal = [{focal:.6g}, {focal:.6g}]
eye = [0.0, {ahead:.6g}, {up:.6g}]
target = [0.0, 0.0, 0.0]

[[lamp]]
position = [{side:.6g}, {ahead:.6g}, {side:.6g}]
intensity = {intensity:.6g}

[[box]]
file = "object.zarr"
"""


def upright(found: hg.Recovered) -> hg.VolumeBox:
    """The box with its middle at the origin and z along the axis that the cameras stand around."""
    cameras = [p.camera for p in found.photographs]
    places = np.stack([camera.position for camera in cameras])
    axis = np.linalg.svd(places - places.mean(axis=0))[2][2]
    above = -sum(camera.world_to_camera[1, :3] for camera in cameras)
    axis *= np.sign(axis @ above)
    first = np.cross(axis, np.eye(3)[np.argmin(np.abs(axis))])
    first /= np.linalg.norm(first)
    turn = np.stack([first, np.cross(axis, first), axis])
    box = found.box()
    corners, pose = box.matter_corners(), np.eye(4)
    pose[:3, :3], pose[:3, 3] = turn, -turn @ (0.5 * (corners.min(axis=0) + corners.max(axis=0)))
    return box.with_pose(pose @ box.pose)


def scene_of(box: hg.VolumeBox) -> str:
    """A camera before the box, a little above it, and a lamp at its side."""
    corners = box.matter_corners()
    radius = 0.5 * float(np.linalg.norm(np.ptp(corners, axis=0)))
    away, side = 8.0 * radius, 5.0 * radius
    return SCENE.format(
        width=WIDTH, focal=FILLED * WIDTH * away / radius, ahead=-0.94 * away, up=0.34 * away, side=side,
        intensity=np.pi * (0.94 * away) ** 2,
    )  # fmt: skip


def main() -> None:
    """Recover, film and publish."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True, help="folder of real captures")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--capture", choices=list(REAL), default="dino_48")
    parser.add_argument("--side", type=int, default=64, help="nodes along the longest edge")
    parser.add_argument("--light", default="auto", help="see `hagoromo recover`")
    parser.add_argument("--frames", type=int, default=24, help="of each film")
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    settings = hg.RecoverySettings(side=given.side, errors=False, light=given.light)
    found = hg.recover(REAL[given.capture](given.data), settings)
    record = found.record()
    hg.write_json(given.out / "object.json", record)
    for key in ("psnr", "inside"):
        mean = np.mean([score[key] for score in record["kept_aside"]])
        print(f"kept aside, {key}: {mean:.2f} dB, mean of {len(record['kept_aside'])}")
    box = upright(found)
    box.save(given.out / "object.zarr", force=True)
    scene = given.out / "scene.toml"
    scene.write_text(scene_of(box), encoding="utf-8")
    hg.film(scene, given.out / "turning.gif", turn=hg.Turn(given.frames, camera=True, lamps=True), force=True)
    hg.film(scene, given.out / "lamp.gif", turn=hg.Turn(given.frames, camera=False, lamps=True), force=True)
    hg.publish_scene(scene, given.out / "page.html", title=given.capture, force=True)
    print(f"hagoromo view {given.out / 'object.zarr'}")


if __name__ == "__main__":
    main()
