"""Figure skin: the boxes of the skin that a standing figure shows, angel or nun, 270 mm high."""

from __future__ import annotations

from typing import Any, NamedTuple

from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.fill import Fineness
from hagoromo.matter.shape import Shape, mirrored, placed
from hagoromo.reflectance.pigment import Pigment, skin_colour
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.figure.body import arms, bust, feet
from hagoromo_matter.figure.face import lips
from hagoromo_matter.figure.pose import PRAYER, WELCOME, Pose
from hagoromo_matter.skin.skin import Flush, Granules, skin_on

# a sixth of life: its lines are finer than any lattice here; a grain and a play of the sheen are left of them
GRANULES = Granules(
    granule_mm=0.14, corneum_mm=9.0, scale_mm=0.2, scale_deg=3.0, primary_mm=0.13, primary_depth_mm=0.01,
    secondary_mm=0.06, secondary_depth_mm=0.004, pore_mm=0.02, pores_per_cm2=600.0, fade_mm=0.03,
)  # fmt: skip
SKIN_FINENESS = Fineness(0.12, 0.17)
LIPS = Pigment(melanin=0.018, blood=0.045, oxygenation=0.85)
LARGEST_SLOPE = 2.5  # slope of the shapes, at nails and at the line between the lips


class BodyPart(NamedTuple):
    """A visible part of the body, and the corners of its box [mm]."""

    shape: Any  # a function of point and pose
    low: tuple[float, float, float]
    high: tuple[float, float, float]


SKIN_PLACES = {  # what lies deeper under clothes is left out: between their threads it would show
    "angel": {
        "head": BodyPart(bust, (-29.0, -28.0, 195.0), (29.0, 26.0, 268.0)),
        "hands": BodyPart(arms, (-66.0, -52.0, 126.0), (66.0, 6.0, 172.0)),
        "feet": BodyPart(feet, (-28.0, -34.0, -0.6), (28.0, 16.0, 61.0)),
    },
    "nun": {
        "head": BodyPart(bust, (-29.0, -28.0, 212.0), (29.0, 26.0, 268.0)),
        "hands": BodyPart(arms, (-21.0, -54.0, 164.0), (21.0, 6.0, 212.0)),
    },
}
POSES = {"angel": WELCOME, "nun": PRAYER}


def figure_skin(figure: str, place: str, material: Reflectance, resolution: float = 1.0, seed: int = 1) -> BoxPlan:
    """The skin of the "head", "hands" or (angel) "feet" of the "angel" or "nun"; resolution: voxels in 0.12 mm."""
    known = SKIN_PLACES.get(figure, {})
    if place not in known:
        where = f"{figure} shows {', '.join(known)}" if known else f"figures are {', '.join(SKIN_PLACES)}"
        raise InputError(f"there is no skin of {figure!r}, {place!r}: {where}")
    _, low, high = known[place]
    record = {"kind": "figure", "figure": figure, "place": place, "resolution": resolution, "seed": seed}
    return skin_on(
        shown(figure, place), (low, high), material, GRANULES, SKIN_FINENESS.finer(resolution), seed, LARGEST_SLOPE,
        Flush(lips_of(figure), reddened(material.body_colour)) if place == "head" else None,
        name=f"{figure}, {place}", provenance=record,
    )  # fmt: skip


def lips_of(figure: str) -> Shape:
    """Membership of a point [mm] in the lips, 0…1."""
    pose = POSES[figure]
    return lambda point: lips(mirrored(placed(point, pose.head, pose.nod)))


def reddened(colour: Spectrum) -> Spectrum:
    """The colour of skin with the higher blood content of lips."""
    lips_, usual = skin_colour(LIPS), skin_colour(Pigment())
    return colour * Spectrum(usual.wavelengths, lips_.values / usual.values)


def shown(figure: str, place: str) -> Shape:
    """The solid of a part of a figure."""
    pose: Pose = POSES[figure]
    return lambda point: SKIN_PLACES[figure][place].shape(point, pose)
