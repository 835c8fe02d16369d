"""Mode full takes texels: their light is that of random walks (mode path) through the same matter, front and back."""

import numpy as np

import hagoromo as hg
from tests.laws.test_texel import quick_sheet

WHITE = hg.Reflectance(0.3, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element="cylinder")
EYE = np.array([0.3, -1.0, 0.4]) / np.linalg.norm([0.3, -1.0, 0.4])
SIZE, WALKS = 24, 256


def test_texels_send_on_in_all_orders_what_random_walks_find(few_match_points):
    """3 % of all light and three standard errors, lamp in front and behind; behind, two thirds are of higher orders.

    A march of the first order alone would be 10 % and 66 % too dark.
    """
    box, focal = quick_sheet(extinction="projected").with_materials([WHITE, WHITE]), SIZE * 0.08 / 6e-3
    camera = hg.Camera(SIZE, SIZE, (focal, focal), (SIZE / 2, SIZE / 2)).look_at(0.08 * EYE, (0.0, 0.0, 0.0))
    for to_lamp, share in (((0.6, -0.7, 0.5), 0.08), ((0.6, 0.7, 0.5), 0.6)):
        scene = hg.Scene(camera, (hg.Lamp(to_lamp=to_lamp),), (box,))
        solved, walked = (
            hg.render(scene, hg.Settings(samples=8, walks=0), mode="full"),
            hg.render(scene, hg.Settings(samples=WALKS), mode="path"),
        )
        higher = [image.weights[..., 2:].mean(axis=-1).sum() for image in (solved, walked)]
        ours, theirs = (
            float(image.weights[..., :2].sum() + part) for image, part in zip((solved, walked), higher, strict=True)
        )
        assert walked.variance is not None
        noise = float(np.sqrt(walked.variance.sum()))  # of Y, which is all light where everything is white
        assert noise < 0.01 * theirs and higher[1] > share * theirs
        assert abs(ours - theirs) < 0.03 * theirs + 3.0 * noise
