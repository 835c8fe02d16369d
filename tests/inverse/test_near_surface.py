"""What stands behind and before the places of a surface, against exact shapes."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays, vectors
from hagoromo.image.relight.stage import basis_camera
from hagoromo.matter import shape as sd
from hagoromo_recovery.descent.light_between import share_between
from hagoromo_recovery.descent.look import FoundLook
from hagoromo_recovery.descent.pixel_table import PixelTable, blurred
from hagoromo_recovery.errors import errors_of
from hagoromo_recovery.evidence import Evidence
from hagoromo_recovery.field.distance_field import DistanceField
from hagoromo_recovery.field.near_surface import NearSurface, on_surface
from hagoromo_recovery.field.object_sky import ObjectSky, Unlit
from hagoromo_recovery.field.surface_march import SurfaceMarch
from hagoromo_recovery.levels import Levels
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.outline.object_view import ObjectView
from hagoromo_recovery.outline.silhouettes import views_of
from hagoromo_recovery.shading.shading import START, coordinates
from hagoromo_recovery.surface_shape import SurfaceShape
from studies.recover_scenes import TrueObject, shots, simulated
from studies.strange_captures import Bowl, ThinPlate

NODES = 28


def shape_of(distance):
    """A grey shape. distance: of places (x, y, z) from the middle [voxel]."""
    z, y, x = np.meshgrid(*(np.arange(NODES) - 13.5,) * 3, indexing="ij")
    values = distance(x, y, z).astype(np.float32)
    lattice = Lattice(np.zeros(3), 0.002, values.shape)
    return SurfaceShape(lattice, values, np.full((*values.shape, 3), 0.5, np.float32), coordinates(*START))


def plate(thickness):
    """An endless plate across z."""
    return shape_of(lambda x, y, z: np.abs(z) - 0.5 * thickness)


@pytest.mark.parametrize(("thickness", "found"), [(2.4, 2.4), (3.0, 3.0), (5.0, np.inf)])
def test_thickness_is_that_of_a_plate(thickness, found):
    """A spline rounds the ridge in its middle, at which the distance is largest, and nothing at its faces."""
    np.testing.assert_allclose(NearSurface(plate(thickness).field()).thickness, found, atol=0.02)


def test_no_errors_are_stated_where_matter_is_thin():
    for thickness, thin in ((2.4, True), (6.0, False)):
        shape = plate(thickness)
        errors = errors_of(shape, [shape, shape], shape)
        near = NearSurface(shape.field()).nodes
        assert (errors.thin[near] == thin).all() and not errors.thin[~near].any()
        assert (np.isnan(errors.position[near]) == thin).all() and (np.isnan(errors.normal[near]) == thin).all()


def test_errors_of_positions_are_ways_whatever_the_slope_of_the_distance():
    """Halves that stand half a voxel apart, as values of a field that rises by 1.6 a voxel."""
    steep, other = (shape_of(lambda x, y, z, a=a: 1.6 * (np.abs(z) - 5.0 - a)) for a in (0.0, 0.5))
    errors = errors_of(steep, [steep, other], None)
    assert np.nanmedian(errors.position) == pytest.approx(0.25 * 0.002, rel=1e-3)
    places = np.array([[13.0, 13.0, 13.5 + 5.4]])
    np.testing.assert_allclose(on_surface(DistanceField(steep.distance, steep.colours), places)[0, 2], 18.5, atol=1e-4)


def test_a_place_of_a_hollow_half_ball_sees_half_of_its_sky_as_object():
    """Every place of a hollow ball sees all others alike, so that the half which is there is half of the sky."""
    cup = shape_of(lambda x, y, z: np.maximum(z - 4.0, 8.0 - np.sqrt(x * x + y * y + (z - 4.0) ** 2)))
    sky = ObjectSky(SurfaceMarch(cup.field(), arrays().Float(5.0), Unlit()))
    away = sky.places - np.array([13.5, 13.5, 17.5])
    inner = (np.einsum("ni,ni->n", away, sky.normals) < -7.0) & (away[:, 2] < -2.0)
    seen = sky.gathered(np.ones((len(sky.sender), 1)))[:, 0]
    assert inner.sum() > 100
    np.testing.assert_allclose(seen[inner], 0.5, atol=0.09)
    assert seen[inner].mean() == pytest.approx(0.5, abs=0.05)  # its rim, which a spline rounds, is 0.5 voxels lower
    flat = (sky.normals[:, 2] > 0.99) & (np.hypot(away[:, 0], away[:, 1]) > 10.0)
    assert flat.sum() > 100 and seen[flat].max() < 0.02


def test_errors_of_normals_widen_the_interval_of_the_gloss():
    """γ by ½ ln(1 + ln 2 · e²/γ²), β by −2 of that: what a blurred highlight of Gauss's form has."""
    known = Evidence(np.diag([0.04, 0.01, 0.09]), np.ones((1, 1, 2), np.int32))
    wider = known.with_normals(np.log([2.0, 0.1, 0.5]), np.array([[[0.05, np.nan]]]))
    across = np.random.default_rng(0).normal(0.0, 0.05 / np.sqrt(2.0), (200_000, 2))
    peak = np.exp2(-(across**2).sum(axis=1) / 0.1**2).mean()
    assert wider.covariance[0, 0] - 0.04 == pytest.approx(np.log(peak) ** 2, rel=0.02)
    assert wider.covariance[1, 1] - 0.01 == pytest.approx(0.25 * np.log(peak) ** 2, rel=0.02)
    assert wider.covariance[0, 1] < 0.0 and wider.covariance[2, 2] == 0.09


def test_rays_beside_the_middle_of_a_pixel_are_those_of_its_camera():
    views = views_of(simulated(TrueObject(flat=True), shots(3, 5, 60, 1, pixels=24), 1).capture.photographs)
    lattice = Lattice.around(np.full(3, -0.06), np.full(3, 0.06), 20)
    pixels = PixelTable(views, lattice, 0.01, 1.0)
    drawn = pixels.of(np.arange(pixels.count // 16))
    moved = pixels.beside(drawn, 0.3, -0.2)
    for number, view in enumerate(views):
        own, camera = np.array(drawn.photograph) == number, view.photograph.camera
        at, other = (
            camera.project(camera.position + np.array(each.rays.direction, np.float64).T[own])
            for each in (drawn, moved)
        )
        np.testing.assert_allclose(other - at, np.broadcast_to([0.3, -0.2], at.shape), atol=2e-3)


def recovered_of(truth, larger, side=24):
    """What a recovery would be that found a shape so much too large [m], of three photographs."""
    capture = simulated(truth, shots(3, 5, 60, 1, pixels=48), 1).capture
    lattice = Lattice.around(np.full(3, -0.055), np.full(3, 0.055), side)
    distance = (np.array(truth.distance(vectors(lattice.nodes().reshape(-1, 3)))) - larger) / lattice.voxel
    nodes = lattice.shape
    values, grey = distance.reshape(nodes).astype(np.float32), np.full((*nodes, 3), 0.4, np.float32)
    shape = SurfaceShape(lattice, values, grey, coordinates(*START))
    errors = errors_of(shape, [shape, shape], None)
    return hg.Recovered(
        lattice, shape.distance, shape.colours, shape.gloss, 0.2, capture.photographs, (), True,
        {"shadows": True}, evidence=Evidence(np.eye(3), np.ones(nodes, np.int32)), errors=errors,
    )  # fmt: skip


class RoundBody(TrueObject):
    """It has no edges."""

    def distance(self, p):
        return sd.sphere(p, (0.0, 0.0, 0.0), 0.03)


def test_outlines_outside_of_those_of_masks_are_measured_and_said():
    """A soft edge of voxels of 5 mm itself stands a tenth of a voxel off."""
    right, large = (recovered_of(RoundBody(), larger) for larger in (0.0, 0.003))
    assert large.beyond - right.beyond == pytest.approx(0.003, abs=2e-4)
    assert abs(right.beyond) < 0.12 * right.lattice.voxel
    assert any("mm outside its masks" in said for said in large.record()["remarks"])
    assert not any("mm outside its masks" in said for said in right.record()["remarks"])


def test_a_box_has_the_body_colours_of_the_surface_however_steep_the_distance():
    """A distance that rises by 1.7 a voxel, as recoveries have it, of a ball whose colours differ by a quarter a voxel
    inwards: the box looks as that of a ball of one colour does.
    """
    ball = recovered_of(RoundBody(), 0.0)
    ball = replace(ball, distance=np.float32(1.7) * ball.distance)
    way = (np.linalg.norm(ball.lattice.nodes(), axis=-1) - 0.03) / ball.lattice.voxel
    colours = np.repeat((0.4 - 0.1 * way)[..., None], 3, axis=3).astype(np.float32)  # 0.4 on the surface
    photograph, response, shown = ball.photographs[0], basis_camera(), []
    camera = replace(photograph.camera, response=response, sensor=None)
    for found in (ball, replace(ball, colours=colours)):
        scene = hg.Scene(camera, photograph.lamps, boxes=(found.box(),))
        shown.append(hg.render(scene, hg.Settings(samples=4)).expose(response)[..., 1])
    bright = shown[0] > 0.5 * shown[0].max()
    assert np.median(shown[1][bright] / shown[0][bright]) == pytest.approx(1.0, abs=0.01)


def test_light_between_parts_of_a_white_bowl_is_said():
    """Of its true shape, and of none that bulges."""
    bowl, ball = (recovered_of(truth, 0.0, 32) for truth in (Bowl(), RoundBody()))
    white = replace(bowl, colours=np.full_like(bowl.colours, 0.8))
    assert any("from other parts of the object" in said for said in white.record()["remarks"])
    assert share_between(replace(ball, colours=np.full_like(ball.colours, 0.8))).max() < 0.02


def test_a_thin_plate_is_said_to_be_thin(tmp_path):
    """It has no stated errors, and the report is written all the same."""
    found = recovered_of(ThinPlate(), 0.003)
    record = found.record()
    thin = next(said for said in record["remarks"] if "thinner" in said)
    assert "24 nodes do not hold it" in thin and "give more nodes (--side 48)" in thin
    assert record["errors"]["too_thin"] == 1.0 and record["errors"]["position_m"] is None
    hg.write_recovery_report(tmp_path / "report.html", found, record)


def test_light_beside_an_outline_is_in_error_by_what_a_soft_edge_hides():
    """Φ(−d/s) of the light of the pixel; outside the outline, of the nearest one inside."""
    silhouette = np.zeros((12, 12), bool)
    silhouette[:, :6] = True
    values = np.where(silhouette, 0.5, 0.0)[..., None] * np.ones(3, np.float32)
    camera = hg.Camera(12, 12, (20.0, 20.0), (6.0, 6.0))
    view = ObjectView(hg.Photograph(values, np.ones_like(values), silhouette, camera), silhouette)
    off = blurred(view, 2.0)
    for column, way in ((5, 0.5), (3, 2.5), (6, 0.5), (8, 2.5)):
        assert np.allclose(off[:, column], 0.5 / (1.0 + np.exp(way / 2.0)))


@pytest.mark.parametrize(("pixels", "end"), [(24, 0.33), (72, None), (240, 0.1)])
def test_an_edge_ends_as_soft_as_a_pixel_blurs_it(pixels, end):
    """0.24 px, but no less than a tenth and no more than a third of a voxel."""
    views = views_of(simulated(TrueObject(flat=True), shots(4, 5, 60, 1, pixels=pixels), 1).capture.photographs)
    lattice = Lattice.around(np.full(3, -0.045), np.full(3, 0.045), 46)  # voxels of 2 mm
    start = SurfaceShape.of_hull(lattice, np.full(lattice.shape, 2.0))
    levels = Levels(views, start, [46], 1 << 10, 0, True, FoundLook().of_views(views))
    camera = views[0].photograph.camera
    voxel = lattice.voxel * min(camera.focal) / np.linalg.norm(camera.position - lattice.middle)  # px
    assert levels.softness == pytest.approx(0.24 / voxel if end is None else end, rel=1e-3)
