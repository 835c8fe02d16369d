"""Hagoromo, through its public functions: a frame makes the medium, the shadow maps and the picture anew."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from peers_scene import ALPHA, EYE, FOCAL, INTENSITY, VOXEL, PeerScene

import hagoromo as hg
from hagoromo.image.scene.settings import Settings

FINEST = 0.0025  # tolerance of the reference: a sixteenth of the usual one
FINEST_UNSHADED = FINEST / 16.0  # without shadows: normals that vary from voxel to voxel need shorter steps


def frames(scene: PeerScene) -> dict[str, Callable[[], NDArray]]:
    """The usual tolerance and four times it, by maps and by brute march; without shadows a fourth of it, too."""
    ready = prepared(scene)
    if scene.study.shadows:
        settings = {
            "tolerance 0.16, shadow maps": Settings(tolerance=0.16),
            "tolerance 0.04, shadow maps": Settings(),
            "tolerance 0.16, brute shadows": Settings(shadows="march", tolerance=0.16),
            "tolerance 0.04, brute shadows": Settings(shadows="march"),
        }
    else:
        settings = {
            "tolerance 0.16": Settings(shadows="none", tolerance=0.16),
            "tolerance 0.04": Settings(shadows="none"),
            "tolerance 0.01": Settings(shadows="none", tolerance=0.01),
        }
    return {name: lambda chosen=chosen: hg.render(ready, chosen).weights[..., 0] for name, chosen in settings.items()}


def reference(scene: PeerScene) -> tuple[NDArray, NDArray]:
    """The reference of errors, radiance and whether it shows matter (bool), at the pixels of `PeerScene.sampled`."""
    finest = Settings(shadows="march", tolerance=FINEST)
    if not scene.study.shadows:
        finest = Settings(shadows="none", tolerance=FINEST_UNSHADED)
    image = hg.render(prepared(scene, scene.stride), finest)
    return image.weights[..., 0], image.alpha > 0.0


def prepared(scene: PeerScene, stride: int = 1) -> hg.Scene:
    """The study as a Hagoromo scene, seen through every `stride`-th pixel of every `stride`-th row."""
    study = scene.study
    matte = hg.Reflectance(ALPHA, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0), element=study.element)
    pose = np.eye(4)
    pose[:3, 3] = -1.0
    box = hg.VolumeBox.from_arrays(scene.density, scene.axis, VOXEL, scene.tau, [matte], pose=pose)
    size, focal = study.pixels // stride, FOCAL * study.pixels / stride
    middle = 0.5 + (study.pixels / 2 - 0.5) / stride  # the middle of pixel 0 stays where it is
    camera = hg.Camera(size, size, (focal, focal), (middle, middle))
    camera = camera.look_at(EYE, (0.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    lamps = [hg.Lamp(to_lamp=to) if study.far else hg.Lamp(position=to, intensity=INTENSITY) for to in scene.lamps]
    return hg.Scene(camera, tuple(lamps), (box,))
