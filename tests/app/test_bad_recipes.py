"""Recipes that cannot be built are refused; every key of every shipped one in test_recipes."""

import pytest

from hagoromo.errors import InputError
from hagoromo_matter.cloth.draft import herringbone, satin, twill
from hagoromo_matter.cloth.weave import LINEN, woven_paths
from hagoromo_matter.drape.drape import over_ball
from hagoromo_matter.drape.hanging import flat, hanging


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("size_mm = 6.0", "size_mm = 0.0", "above 0"),
        ("size_mm = 6.0", "size_mm = nan", "finite"),
        ("size_mm = 6.0", "size_mm = 1e6", "too fine"),
        ("size_mm = 6.0", "size_m = 6.0", "unknown key 'size_m'"),
        ("beta = 0.5", "beta = -0.5", "beta"),
        ("alpha = 0.2", "alpha = 0.9", "energy conservation"),
        ('kind = "skin"', 'kind = "scales"', "one of cloth"),
        ("[material]", "[materials]", "material"),
        ("body_colour = 0.7", 'body_colour = "../red.csv"', "points outside"),
    ],
)
def test_a_bad_recipe_is_refused(refused, tmp_path, old, new, said, recipe):
    assert old in recipe
    (tmp_path / "matter.toml").write_text(recipe.replace(old, new))
    assert said in refused("build", tmp_path / "matter.toml", "--out", tmp_path / "matter.zarr")


@pytest.mark.parametrize(
    "more",
    [
        'variants = 1000000000', 'lay = "hanging"\nfolds = 1000000000', '[draft]\nweave = "satin"\nends = 1000000000',
        '[draft]\nweave = "twill"\nover = 1000000000', '[draft]\nweave = "twill"\nover = 1999\nunder = 1999',
        '[draft]\nweave = "herringbone"\nwidth = 1000000000', '[draft]\nweave = "jacquard"\nends = 1999',
        "[warp]\nfibres = 1000000000", "[warp]\nhairs_per_cm = 1e12", "[warp]\nslubs_per_cm = 1e12",
        "[weft]\nplies = 1000000000", "resolution = 1e300", "threads_per_cm = 1e300",
    ],
)  # fmt: skip
def test_numbers_that_decide_the_size_have_a_bound(refused, tmp_path, more, recipe):
    cloth = recipe.replace('kind = "skin"\nsize_mm = 6.0', f'kind = "cloth"\n{more}')
    (tmp_path / "matter.toml").write_text(cloth)
    said = refused("build", tmp_path / "matter.toml", "--out", tmp_path / "matter.zarr")
    assert "matter.toml" in said and "GiB" not in said


@pytest.mark.parametrize("make", [lambda: satin(10**9), lambda: twill(10**9), lambda: herringbone(width=10**9)])
def test_drafts_have_a_bound_in_calls_too(make):
    with pytest.raises(InputError, match="at most 4000000 crossings"):
        make()


@pytest.mark.parametrize(
    "make",
    [
        lambda: flat((1e9, 1e9)), lambda: hanging((1e9, 30.0), 3, 7.0), lambda: over_ball((1e9, 1.0), 5.0),
        lambda: woven_paths(LINEN._replace(warp_per_cm=1e-9, weft_per_cm=1e-9), 0.1, 4, 0),
        lambda: woven_paths(LINEN._replace(warp_colours=tuple(range(1_000_003))), 0.1, 256, 0),
    ],
)  # fmt: skip
def test_cloth_that_does_not_fit_the_memory_is_refused_before_it_is_laid(make):
    with pytest.raises(InputError, match="GiB of memory"):
        make()
