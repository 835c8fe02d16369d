"""The scenes of the paper's figures 6, 7 and 8: an angel and a nun of measured matter, close up and whole."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.image.scene.scene import Scene
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.build import kept_box
from hagoromo.progress import Progress
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.box_header import Extinction
from hagoromo_matter.demo.studio import background, ball_around, framed, studio_lamps, turned_upright
from hagoromo_matter.figure.figure import PART_MATERIALS, figure_part
from hagoromo_matter.figure.tresses import HAIR_COLOUR

MM = 1e-3  # m


class FigureView(NamedTuple):
    """View of a figure of the paper.

    figures: the persons, with the place (x, y) [mm] and rotation about z [°] of each. upright: whether the camera is
    upright. towards: direction from the matter to the camera. filled: share of the picture that the boxes span. seen:
    centre (x, y, z) and height [mm] of a close-up of the first figure; None: all. without: parts that are left out.
    """

    caption: str
    figures: Mapping[str, tuple[float, float, float]]
    upright: bool
    towards: tuple[float, float, float]
    filled: float = 0.9
    seen: tuple[tuple[float, float, float], float] | None = None
    without: tuple[str, ...] = ()


NO_OFFSET = (0.0, 0.0, 0.0)
PAPER_FIGURES = {
    "figure_6_drape": FigureView(
        "Drape: the angel's sleeve and hand; a weave of yarns, made of cylinders.",
        {"angel": NO_OFFSET}, False, (0.5, -1.0, 0.1), seen=((38.0, -14.0, 148.0), 62.0), without=("wings", "feet"),
    ),
    "figure_6_wing": FigureView(
        "Wing: shafts, barbs and barbules, made of cylinders.",
        {"angel": NO_OFFSET}, False, (0.25, -1.0, 0.1), seen=((92.0, 40.0, 232.0), 95.0), without=("feet", "hands"),
    ),
    "figure_7_skin": FigureView(
        "Skin: scales, made of planes; the nun's face.",
        {"nun": NO_OFFSET}, True, (0.3, -1.0, 0.06), seen=((0.0, -10.0, 243.0), 66.0),
    ),
    "figure_7_hair": FigureView(
        "The angel's face and hair.",
        {"angel": NO_OFFSET}, True, (-0.25, -1.0, 0.04), seen=((0.0, -8.0, 243.0), 82.0), without=("feet", "hands"),
    ),
    "figure_8_angel": FigureView(
        "The whole angel: skin, hair, drape and wings.", {"angel": NO_OFFSET}, True, (0.16, -1.0, 0.1),
    ),
    "figure_8_nun": FigureView("The whole nun: skin, wool and linen.", {"nun": NO_OFFSET}, True, (-0.3, -1.0, 0.1)),
    "figure_8_whole": FigureView(
        "The angel and the nun.",
        {"angel": (-62.0, 14.0, 8.0), "nun": (96.0, -42.0, -24.0)}, False, (0.06, -1.0, 0.1), filled=0.9,
    ),
}  # fmt: skip


class Cast:
    """The parts of the figures; each is built at its first use and reused in later pictures.

    measured: reflectances of skin, cloth, feather and dielectric. resolution: of all lattices. seed: of the matter.
    without: parts that are left out of all pictures. extinction: of all boxes, see `VolumeBox`.
    """

    def __init__(
        self,
        measured: Mapping[str, Reflectance],
        resolution: float,
        seed: int,
        without: tuple[str, ...] = (),
        extinction: Extinction = "isotropic",
    ) -> None:
        self.measured, self.resolution, self.seed, self.without = measured, resolution, seed, without
        self.extinction: Extinction = extinction
        self.materials, self._boxes = wardrobe(measured), {}

    def scene(self, name: str, camera: Camera, progress: Progress) -> Scene:
        """The scene of one of PAPER_FIGURES."""
        shot, boxes, wanted = PAPER_FIGURES[name], [], self.parts(name)
        for number, (who, part) in enumerate(wanted):
            progress(number / len(wanted))
            box = self.box(who, part)
            boxes.append(box.with_pose(_placed(*shot.figures[who]) @ box.pose))
        camera = turned_upright(camera) if shot.upright else camera
        middle, extent = ball_around(boxes)
        if shot.seen:
            camera = close_up(camera, shot.towards, *shot.seen)
        else:
            camera = framed(camera, boxes, shot.towards, shot.filled)
        ground = background(extent, self.measured["dielectric"])
        return Scene(camera, studio_lamps(middle, extent), tuple(boxes), (ground,))

    def parts(self, name: str) -> list[tuple[str, str]]:
        """Each person and part that one of PAPER_FIGURES shows."""
        without = {*PAPER_FIGURES[name].without, *self.without}
        return [(who, part) for who in people(name) for part in PART_MATERIALS[who] if part not in without]

    def box(self, who: str, part: str) -> VolumeBox:
        """The volume box of a part of a figure, where it was built."""
        if (who, part) not in self._boxes:
            material = self.materials[PART_MATERIALS[who][part]]
            self._boxes[who, part] = kept_box(
                [who, part, material.record(), self.resolution, self.seed, self.extinction],
                lambda: figure_part(who, part, material, self.resolution, self.seed, self.extinction).box(),
            )
        return self._boxes[who, part]


def people(name: str) -> tuple[str, ...]:
    """Who is in one of PAPER_FIGURES."""
    return tuple(PAPER_FIGURES[name].figures)


def wardrobe(measured: Mapping[str, Reflectance]) -> dict[str, Reflectance]:
    """Materials of the figures: measured skin, cloth and feather; other garments are the same cloth in other dyes.

    Hair has the measured interface of the feather, which is keratin as well, and its own colour.
    """
    cloth = measured["cloth"]
    return {
        "skin": measured["skin"],
        "feather": measured["feather"],
        "robe": cloth,
        "hair": replace(measured["feather"], alpha=1.0 / np.pi, body_colour=HAIR_COLOUR, name="hair"),
        "brows": replace(measured["feather"], alpha=1.0 / np.pi, body_colour=HAIR_COLOUR.scaled(0.3), name="brows"),
        "habit": _dyed(cloth, (0.030, 0.026, 0.027, 0.034), "black cloth"),
        "veil": _dyed(cloth, (0.034, 0.030, 0.030, 0.040), "black cloth"),
        "linen": _dyed(cloth, (0.50, 0.58, 0.61, 0.62), "undyed cloth"),
    }


def close_up(
    camera: Camera, towards: tuple[float, float, float], middle: tuple[float, float, float], height: float
) -> Camera:
    """The camera at the distance where `height` [mm] around `middle` [mm] fills the picture."""
    aim, direction = MM * np.array(middle), np.array(towards) / np.linalg.norm(towards)
    return camera.look_at(aim + direction * (MM * height * camera.focal[1] / camera.height), aim)


def _dyed(cloth: Reflectance, reflectance: tuple[float, ...], name: str) -> Reflectance:
    """The same fibres in another colour: diffuse reflectance at 380, 480, 580 and 730 nm."""
    return replace(cloth, alpha=1.0 / np.pi, body_colour=Spectrum((380, 480, 580, 730), reflectance), name=name)


def _placed(x: float, y: float, turn: float) -> NDArray[np.float64]:
    """Pose of a figure: translated by x, y [mm] and rotated about z [°]."""
    pose, (cosine, sine) = np.eye(4), (np.cos(np.radians(turn)), np.sin(np.radians(turn)))
    pose[:2, :2] = [[cosine, -sine], [sine, cosine]]
    pose[:2, 3] = MM * x, MM * y
    return pose
