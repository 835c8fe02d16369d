"""Recipes that cannot be built are refused; every key of every shipped one in test_recipes."""

import pytest


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("size_mm = 6.0", "size_mm = 0.0", "above 0"),
        ("size_mm = 6.0", "size_mm = nan", "finite"),
        ("size_mm = 6.0", "size_mm = 1e6", "too fine"),
        ("size_mm = 6.0", "size_m = 6.0", "unknown key 'size_m'"),
        ("beta = 0.5", "beta = -0.5", "beta"),
        ("alpha = 0.2", "alpha = 0.9", "energy conservation"),
        ('kind = "skin"', 'kind = "scales"', "one of skin"),
        ("[material]", "[materials]", "material"),
        ("body_colour = 0.7", 'body_colour = "../red.csv"', "points outside"),
    ],
)
def test_a_bad_recipe_is_refused(refused, tmp_path, old, new, said, recipe):
    assert old in recipe
    (tmp_path / "matter.toml").write_text(recipe.replace(old, new))
    assert said in refused("build", tmp_path / "matter.toml", "--out", tmp_path / "matter.zarr")
