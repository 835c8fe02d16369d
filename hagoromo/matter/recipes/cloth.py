"""Kind "cloth": woven after a draft, from yarns, laid flat or draped.

    threads_per_cm, or warp_per_cm and weft_per_cm; crimp, uneven, warp_colours, weft_colours: see `Woven`
    [draft]     weave = "plain" | "twill" (over, under) | "satin" (ends, step, warp_faced) |
                "herringbone" (over, under, width) | "jacquard" (pattern, ends), or file = "NAME.wif", which also
                tells yarns per cm, diameters, warp_colours, weft_colours and [[colour]], where the recipe does not
    [warp]      of the warp yarns: see `Yarn`
    [weft]      of the weft yarns: what is not said is the warp's
    [[colour]]  keys of [material] that yarns of colour number 0, 1, … have in its place
    how it lies: see `laid`

Element cylinder. voxel_mm of the texel: a twelfth of a yarn shows plies and twist, a third of a fibre single fibres.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from hagoromo.files.record import count, flag, list_of, number, one_of, positive, table, take, text
from hagoromo.light.colour import srgb_decode
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.matter.cloth import draft
from hagoromo.matter.cloth.fabric import woven
from hagoromo.matter.cloth.weave import LINEN, Woven, check_woven
from hagoromo.matter.cloth.yarn import Yarn
from hagoromo.matter.recipes.laid import LAID, laid
from hagoromo.matter.recipes.recipe import Kind, Recipe, fineness_keys, with_defaults
from hagoromo.reflectance.material.material_table import reflectance_from_table
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan

WEAVES: dict[str, dict[str, Any]] = {
    "plain": {},
    "twill": {"over": (count, 2), "under": (count, 2)},
    "satin": {"ends": (count, 5), "step": (count, 0), "warp_faced": (flag, True)},
    "herringbone": {"over": (count, 2), "under": (count, 2), "width": (count, 8)},
    "jacquard": {"pattern": (list_of(text), draft.DIAMOND), "ends": (count, 5)},
}
WHITE = 0.85  # body colour of bleached yarn
Colours = tuple[tuple[float, ...], ...]
YARN = {"plies": count, "fibres": count, "hand": one_of("Z", "S")}  # what is no plain number


def _plan(recipe: Recipe) -> BoxPlan:
    drawn, colours = _drawn(recipe)
    warp = yarn_of(recipe, "warp", drawn.warp)
    other = drawn.weft.diameter_mm if drawn.weft.diameter_mm != drawn.warp.diameter_mm else warp.diameter_mm
    ends, picks = (recipe[k] or recipe["threads_per_cm"] or getattr(drawn, k) for k in ("warp_per_cm", "weft_per_cm"))
    first, second = (
        getattr(drawn, k) if recipe[k] is None else tuple(recipe[k]) for k in ("warp_colours", "weft_colours")
    )
    weft, crimp, uneven = yarn_of(recipe, "weft", warp._replace(diameter_mm=other)), recipe["crimp"], recipe["uneven"]
    cloth = check_woven(Woven(drawn.draft, ends, picks, warp, weft, crimp, uneven, first, second))
    materials = colour_materials(recipe, [colour for _, colour in cloth.palette], colours)
    fabric = woven(cloth, recipe.fineness.voxel_mm, max(recipe["variants"], 1), recipe["seed"])
    return laid(recipe, fabric, materials, "cloth")


def yarn_of(recipe: Recipe, name: str, usual: Yarn) -> Yarn:
    """The yarn of the table `name`; what it leaves out is that of `usual`."""
    return Yarn(**take(recipe[name], with_defaults(usual, YARN, number), f"{recipe.where} [{name}]"))


def colour_materials(recipe: Recipe, colours: list[int], display: Colours = ()) -> list[Reflectance]:
    """The reflectance for each of `colours`, numbers of [[colour]]; those of none have that of [material].

    display: the body colours (sRGB, 0…1) of numbers that [[colour]] does not tell.
    """
    usual = recipe.material  # checked, even where every yarn has a colour of its own
    own = recipe["colour"] or [{"body_colour": body_colour(colour).record()} for colour in display]
    found = [
        reflectance_from_table(
            recipe["material"] | keys, recipe.folder, f"{recipe.where} [[colour]] {number}", recipe.element
        )
        for number, keys in enumerate(own)
    ]
    return [found[colour] if colour < len(found) else usual for colour in colours]


def body_colour(display: tuple[float, ...]) -> Spectrum:
    """The smooth spectrum of a display colour (sRGB, 0…1), whose white is that of bleached yarn."""
    linear = srgb_decode(255.0 * np.array(display))
    bands = smooth_rgb_basis()
    return Spectrum(bands[0].wavelengths, WHITE * sum(c * b.values for c, b in zip(linear, bands, strict=True)))


def _drawn(recipe: Recipe) -> tuple[Woven, Colours]:
    """What [draft] tells: the weave, of LINEN's yarns where it tells none, and the colours of the yarns of a file."""
    where, given = f"{recipe.where} [draft]", recipe["draft"]
    if "file" in given:
        from hagoromo.matter.cloth.wif import cloth_of, read_wif

        path = recipe.file(take(given, {"file": text}, where)["file"])
        return cloth_of(read_wif(path), LINEN.warp, LINEN.weft)
    weave = take(given, {"weave": one_of(*WEAVES)}, where, strict=False)["weave"]
    keys = take(given, {"weave": text, **WEAVES[weave]}, where)
    del keys["weave"]
    return LINEN._replace(draft=getattr(draft, weave)(**keys)), ()


KEYS = {
    "threads_per_cm": (positive, None), "warp_per_cm": (positive, None), "weft_per_cm": (positive, None),
    "crimp": (number, LINEN.crimp), "uneven": (number, LINEN.uneven), "warp_colours": (list_of(count), None),
    "weft_colours": (list_of(count), None), "draft": (table, {"weave": "plain"}), "warp": (table, {}),
    "weft": (table, {}), "colour": (list_of(table), []),
}  # fmt: skip
KIND = Kind("cylinder", KEYS | LAID | fineness_keys(0.03, 0.03), _plan)
