"""Figure: an angel and a nun, 270 mm high, as volume boxes: skin, hair, garments and wings.

Both stand on z = 0 around x = 0 and look towards −y.
"""

from __future__ import annotations

from dataclasses import replace

from hagoromo.errors import InputError
from hagoromo.reflectance.element import Element
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import Extinction
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.feather.wing import wing_of
from hagoromo_matter.figure.figure_skin import SKIN_PLACES, figure_skin
from hagoromo_matter.figure.tresses import hair_of
from hagoromo_matter.figure.wardrobe import WARDROBE, garment_of

# the parts of each figure, and the material that each is made of
PART_MATERIALS: dict[str, dict[str, str]] = {
    "angel": dict.fromkeys(SKIN_PLACES["angel"], "skin") | {"hair": "hair"} | {"robe": "robe", "wings": "feather"},
    "nun": dict.fromkeys(SKIN_PLACES["nun"], "skin") | {"hair": "brows"} | {name: name for name in WARDROBE["nun"]},
}
FIGURE_ELEMENTS: dict[str, Element] = {"skin": "sphere"}  # of materials; cylinder for all others
FIGURE_PARTS = tuple(sorted({part for parts in PART_MATERIALS.values() for part in parts}))


def figure_part(
    name: str,
    part: str,
    material: Reflectance,
    resolution: float = 1.0,
    seed: int = 1,
    extinction: Extinction = "isotropic",
) -> BoxPlan:
    """The plan of one part of the "angel" or the "nun"; its material is of the element that the matter has."""
    parts = _parts(name)
    if part not in parts:
        raise InputError(f"the {name} has no part {part!r}: give one of {', '.join(parts)}")
    if material.element != element_of(name, part):
        material = replace(material, element=element_of(name, part))
    if part in SKIN_PLACES[name]:
        return figure_skin(name, part, material, resolution, seed).with_extinction(extinction)
    if part == "hair":
        return hair_of(name, material, resolution, seed).with_extinction(extinction)
    if part == "wings":
        return wing_of(material, resolution, seed).with_extinction(extinction)
    return garment_of(name, part, material, resolution, seed, extinction)


def element_of(name: str, part: str) -> Element:
    """The element of a part's matter."""
    return FIGURE_ELEMENTS.get(_parts(name)[part], "cylinder")


def _parts(name: str) -> dict[str, str]:
    if name not in PART_MATERIALS:
        raise InputError(f"there is no figure {name!r}: give one of {', '.join(PART_MATERIALS)}")
    return PART_MATERIALS[name]
