"""Kind "cloth": woven after a draft, from yarns, laid flat or draped.

    threads_per_cm, or warp_per_cm and weft_per_cm; crimp, uneven, warp_colours, weft_colours: see `Woven`
    [draft]     weave = "plain" | "twill" (over, under) | "satin" (ends, step, warp_faced) |
                "herringbone" (over, under, width) | "jacquard" (pattern, ends), or file = "NAME.wif", which also
                states yarns per cm, diameters, warp_colours, weft_colours and [[colour]], where the recipe does not
    [warp]      of the warp yarns: see `Yarn`
    [weft]      of the weft yarns: what is not said is the warp's
    [[colour]]  keys of [material] that yarns of colour number 0, 1, … have in its place
    how it lies: see `laid`

Element cylinder. voxel_mm of the texel: a twelfth of a yarn shows plies and twist, a third of a fibre single fibres.
"""

from __future__ import annotations

from typing import Annotated, Any

import numpy as np
from msgspec import field

from hagoromo.files.record import Count, Positive, Record, about, decode, decode_one, from_to, given, like, optional
from hagoromo.light.colour import srgb_decode
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.matter.recipe import Kind, MeanFreePath, Recipe, Voxel
from hagoromo.reflectance.material.material_table import PARTS
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.cloth import draft
from hagoromo_matter.cloth.fabric import woven
from hagoromo_matter.cloth.weave import LINEN, Woven, check_woven
from hagoromo_matter.cloth.yarn import Yarn
from hagoromo_matter.recipes.laid import LaidTable, laid


class Plain(Record, frozen=True, tag_field="weave", tag="plain"):
    """Plain weave: over one, under one."""

    def draft(self) -> draft.Draft:  # pyrefly: ignore[not-a-type]
        """One repeat."""
        return draft.plain()


class Twill(Record, frozen=True, tag_field="weave", tag="twill"):
    """Twill: each end does as its neighbour, one pick later."""

    over: Annotated[int, from_to(1, draft.LARGEST_REPEAT), about("picks that the warp goes over")] = 2
    under: Annotated[int, from_to(1, draft.LARGEST_REPEAT), about("picks that the warp goes under")] = 2

    def draft(self) -> draft.Draft:  # pyrefly: ignore[not-a-type]
        """One repeat."""
        return draft.twill(self.over, self.under)


class Satin(Record, frozen=True, tag_field="weave", tag="satin"):
    """Satin: an end goes under one pick of a repeat."""

    ends: Annotated[int, from_to(5, draft.LARGEST_REPEAT), about("ends of a repeat: 5, 7 or more")] = 5
    step: Annotated[
        int,
        from_to(0, draft.LARGEST_REPEAT),
        about("ends by which the place moves from pick to pick; 0: the smallest that fits"),
    ] = 0
    warp_faced: Annotated[bool, about("whether the warp floats on the face; false: sateen")] = True

    def draft(self) -> draft.Draft:  # pyrefly: ignore[not-a-type]
        """One repeat."""
        return draft.satin(self.ends, self.step, self.warp_faced)


class Herringbone(Record, frozen=True, tag_field="weave", tag="herringbone"):
    """A twill whose line turns."""

    over: Annotated[int, from_to(1, draft.LARGEST_REPEAT), about("picks that the warp goes over")] = 2
    under: Annotated[int, from_to(1, draft.LARGEST_REPEAT), about("picks that the warp goes under")] = 2
    width: Annotated[int, from_to(2, draft.LARGEST_DRAFT), about("ends after which the line turns")] = 8

    def draft(self) -> draft.Draft:  # pyrefly: ignore[not-a-type]
        """One repeat."""
        return draft.herringbone(self.over, self.under, self.width)


class Jacquard(Record, frozen=True, tag_field="weave", tag="jacquard"):
    """A pattern in weft-faced satin on warp-faced satin."""

    pattern: Annotated[tuple[str, ...], about("rows of signs; each is one repeat of the satin, 1: weft-faced")] = (
        draft.DIAMOND
    )
    ends: Annotated[int, from_to(5, draft.LARGEST_REPEAT), about("ends of a repeat of the satin")] = 5

    def draft(self) -> draft.Draft:  # pyrefly: ignore[not-a-type]
        """One repeat."""
        return draft.jacquard(self.pattern, self.ends)


class DraftFile(Record, frozen=True):
    """A draft as weaving programs write it; it states yarns and colours, too, where the recipe does not."""

    file: Annotated[str, about("WIF file")]


WEAVES = (Plain, Twill, Satin, Herringbone, Jacquard)
YarnTable = optional("YarnTable", Yarn)
BLEACHED = 0.85  # body colour of bleached yarn
Colours = tuple[tuple[float, ...], ...]


class ClothTable(LaidTable, frozen=True, kw_only=True):
    """A woven cloth."""

    voxel_mm: Voxel = 0.03
    mean_free_path_mm: MeanFreePath = 0.03
    threads_per_cm: Annotated[Positive | None, about("yarns per cm, both ways [1/cm]")] = None
    warp_per_cm: Annotated[Positive | None, about("warp yarns per cm [1/cm]")] = None
    weft_per_cm: Annotated[Positive | None, about("weft yarns per cm [1/cm]")] = None
    crimp: Annotated[float, about("share of the warp in rising and falling, 0…1; 1: the weft lies straight")] = (
        LINEN.crimp
    )
    uneven: Annotated[float, about("standard deviation of the yarns' places, as a share of their distance")] = (
        LINEN.uneven
    )
    warp_colours: Annotated[
        tuple[Count, ...] | None, about("numbers of the [[colour]] of neighbouring warp yarns, repeated")
    ] = None
    weft_colours: Annotated[
        tuple[Count, ...] | None, about("numbers of the [[colour]] of neighbouring weft yarns, repeated")
    ] = None
    draft: Annotated[dict[str, Any], like(*WEAVES, DraftFile), about("how the yarns cross")] = field(
        default_factory=lambda: {"weave": "plain"}
    )
    warp: Annotated[dict[str, Any], like(YarnTable), about("the warp yarns")] = {}
    weft: Annotated[dict[str, Any], like(YarnTable), about("the weft yarns; what is left out is the warp's")] = {}
    colour: Annotated[
        list[Annotated[dict[str, Any], PARTS]], about("what yarns of colour 0, 1, … have in the place of [material]")
    ] = []


def _plan(recipe: Recipe[ClothTable]) -> BoxPlan:
    table, (cloth, colours) = recipe.table, _woven(recipe)
    materials = colour_materials(recipe, [colour for _, colour in cloth.palette], colours)
    fabric = woven(cloth, recipe.fineness.voxel_mm, max(table.variants, 1), table.seed)
    return laid(recipe, fabric, materials, "cloth")


def _woven(recipe: Recipe[ClothTable]) -> tuple[Woven, Colours]:
    """The cloth, its yarns checked, and the colours of a file's yarns."""
    table, (drawn, colours) = recipe.table, _drawn(recipe)
    warp = yarn_of(table.warp, drawn.warp, f"{recipe.where} [warp]")
    other = drawn.weft.diameter_mm if drawn.weft.diameter_mm != drawn.warp.diameter_mm else warp.diameter_mm
    ends, picks = (
        getattr(table, k) or table.threads_per_cm or getattr(drawn, k) for k in ("warp_per_cm", "weft_per_cm")
    )
    first, second = (
        getattr(drawn if getattr(table, k) is None else table, k) for k in ("warp_colours", "weft_colours")
    )
    weft = yarn_of(table.weft, warp._replace(diameter_mm=other), f"{recipe.where} [weft]")
    return check_woven(Woven(drawn.draft, ends, picks, warp, weft, table.crimp, table.uneven, first, second)), colours


def yarn_of(table: dict[str, Any], usual: Yarn, where: str) -> Yarn:
    """The yarn of a table; what it leaves out is that of `usual`."""
    return usual._replace(**given(decode(table, YarnTable, where)))


def colour_materials(recipe: Recipe[ClothTable], colours: list[int], display: Colours = ()) -> list[Reflectance]:
    """The reflectance for each of `colours`, numbers of [[colour]]; those of none have that of [material].

    display: the body colours (sRGB, 0…1) of numbers that [[colour]] does not state.
    """
    usual = recipe.material  # checked, even where every yarn has a colour of its own
    own = recipe.table.colour or [{"body_colour": body_colour(colour).record()} for colour in display]
    materials = [
        recipe.reflectance(recipe.table.material | keys, f"[[colour]] {number}") for number, keys in enumerate(own)
    ]
    return [materials[colour] if colour < len(materials) else usual for colour in colours]


def body_colour(display: tuple[float, ...]) -> Spectrum:
    """The smooth spectrum of a display colour (sRGB, 0…1), whose white is that of bleached yarn."""
    linear = srgb_decode(255.0 * np.array(display))
    bands = smooth_rgb_basis()
    return Spectrum(bands[0].wavelengths, BLEACHED * sum(c * b.values for c, b in zip(linear, bands, strict=True)))


def _drawn(recipe: Recipe[ClothTable]) -> tuple[Woven, Colours]:
    """What [draft] states: the weave, of LINEN's yarns where it states none, and the colours of the yarns of a file."""
    where, table = f"{recipe.where} [draft]", recipe.table.draft
    if "file" in table:
        from hagoromo_matter.cloth.wif import cloth_of, read_wif

        path = recipe.file(decode(table, DraftFile, where).file)
        return cloth_of(read_wif(path), LINEN.warp, LINEN.weft)
    return LINEN._replace(draft=decode_one(table, WEAVES, where).draft()), ()


KIND = Kind("cylinder", ClothTable, _plan, check=_woven)
