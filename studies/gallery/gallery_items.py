"""Gallery items: what is shown of every recipe, and which keys differ from the file in each view."""

from __future__ import annotations

from typing import Any, NamedTuple


class Item(NamedTuple):
    """A recipe (name of its file), its title, and keys that differ in the views; None: no such view.

    whole: all of it. centimetre, millimetre: fields of view of 10 and 1 mm around the middle of a patch. scan: mesh in
    the folder of the data, in place of the recipe's shape. stops: of exposure, from that which makes the brightest part
    nearly white; below 0 for what is dark in life.
    """

    recipe: str
    title: str
    whole: dict[str, Any] | None = None
    centimetre: dict[str, Any] | None = None
    millimetre: dict[str, Any] | None = None
    scan: str = ""
    stops: float = 0.0


IVORY = {"wavelengths": [380, 450, 550, 650, 730], "values": [0.55, 0.68, 0.8, 0.86, 0.88]}
SCAN_POSE = {"height_mm": 120.0, "rotation_deg": [0.0, 0.0, 165.0]}  # it faces +y
PROJECTED = {"extinction": "projected", "mean_free_path_mm": 0.015}  # as dense in the mean as the recipes
LETS_THROUGH = {"alpha": 0.16, "beta": 0.2, "transmission": 0.38, "clearness": 0.3}  # keys of a material


def _cloth(recipe: str, title: str, yarn_mm: float, fibre_um: float, **whole: Any) -> Item:
    """A cloth: hanging in folds or over a ball, a flat patch in which yarns, and one in which fibres are seen apart."""
    hanging = {"lay": "hanging", "width_mm": 60.0, "height_mm": 70.0, "voxel_mm": yarn_mm / 7, "variants": 2} | whole
    near = {"lay": "patch", "width_mm": 11.5, "height_mm": 11.5, "voxel_mm": yarn_mm / 14}
    nearest = {"width_mm": 1.5, "height_mm": 1.5, "voxel_mm": fibre_um / 2.5e3}
    return Item(recipe, title, hanging, near, near | nearest)


def _feather(recipe: str, title: str, middle_mm: tuple[float, float]) -> Item:
    """A feather, and two patches of its vane around `middle_mm` (across, along)."""
    near = {"patch_mm": [11.0, 11.0], "middle_mm": list(middle_mm), "voxel_mm": 0.03}
    return Item(recipe, title, {}, near, near | {"patch_mm": [1.4, 1.4], "voxel_mm": 0.005})


ITEMS = {
    "skin": Item(
        "skin", "Skin", {"shape": {"form": "sphere", "radius_mm": 6.0}, "voxel_mm": 0.045},
        {"size_mm": 13.0, "voxel_mm": 0.035}, {"size_mm": 1.6, "voxel_mm": 0.008},
    ),
    "linen": _cloth("linen", "Linen, plain weave", 0.34, 18.0),
    "twill": _cloth("twill", "Wool, 2/2 twill", 0.42, 21.0, lay="ball", height_mm=60.0, radius_mm=13.0),
    "herringbone": _cloth("herringbone", "Wool, herringbone", 0.55, 26.0),
    "satin": _cloth("satin", "Silk, satin of eight", 0.11, 11.0, voxel_mm=0.02),
    "jacquard": _cloth("jacquard", "Jacquard block", 0.2, 13.0, voxel_mm=0.035, variants=1),
    "stockinette": _cloth("stockinette", "Wool, stockinette", 0.42, 21.0),
    "primary": _feather("primary", "Primary feather", (4.0, 55.0)),
    "covert": _feather("covert", "Covert", (2.0, 22.0)),
    "down": _feather("down", "Down", (3.0, 14.0)),
    "hair": Item("hair", "Head of hair", {}, stops=-1.8),
    "linen_through": Item(
        "linen", "White linen that lets light through",
        {"lay": "hanging", "width_mm": 60.0, "height_mm": 70.0, "voxel_mm": 0.34 / 7, "variants": 2}
        | PROJECTED
        | {"material": LETS_THROUGH | {"transmitted_colour": 0.95}},
    ),
    "primary_through": Item(
        "primary", "Primary feather that lets light through",
        PROJECTED | {"material": LETS_THROUGH, "marking_material": {"transmitted_colour": 0.25}},
    ),
    "wing": Item("wing", "Wings", {}),
    "scan": Item(
        "solid", "A scan as a solid: Lucy, from the Stanford 3D Scanning Repository",
        {"voxel_mm": 0.2, "mean_free_path_mm": 0.15,
         "material": {"alpha": 0.27, "beta": 0.15, "gamma": 0.3, "body_colour": IVORY}},
        scan="meshes_volumes/lucy.ply",
    ),
    "cloth_10_cm": Item(
        "linen", "Linen, 10 × 10 cm at 20 threads/cm",
        {"width_mm": 100.0, "height_mm": 100.0, "threads_per_cm": 20.0, "warp_per_cm": 20.0, "weft_per_cm": 20.0,
         "warp": {"diameter_mm": 0.26, "fibres": 90, "fibre_um": 17.0}},
    ),
}  # fmt: skip
