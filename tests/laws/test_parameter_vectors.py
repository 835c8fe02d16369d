"""Parameter vectors: what packs one and what takes it apart are inverse to each other."""

import numpy as np

from hagoromo.calibration.lamps.uncalibrated import joint_surface
from hagoromo.measurement.normals import photometric_step
from hagoromo.measurement.parameters import pack_theta, unpack_theta


def test_theta_of_a_material_is_unpacked_as_it_was_packed():
    alpha_body = np.array([0.3, 0.2, 0.1])
    for nu, colour in ((np.inf, np.ones(3)), (1.7, np.array([1.5, 1.2, 0.3]))):
        unpacked = unpack_theta(pack_theta(alpha_body, 0.4, 0.2, 1.5, nu, colour))
        np.testing.assert_allclose(unpacked[0], alpha_body)
        np.testing.assert_allclose(unpacked[1:5], (0.4, 0.2, 1.5, nu), rtol=1e-14)
        np.testing.assert_allclose(unpacked[5], colour, rtol=1e-14)


def test_shared_parameters_of_the_photometric_fit_are_unpacked_as_they_were_packed():
    random = np.random.default_rng(0)
    gloss, lamps = random.random((3, 7)), random.random((5, photometric_step.OF_LAMP))
    unpacked = photometric_step.unpack_shared(photometric_step.pack_shared(gloss, lamps, 0.7), (3, 7))
    np.testing.assert_array_equal(unpacked[0], gloss)
    np.testing.assert_array_equal(unpacked[1], lamps)
    assert unpacked[2] == 0.7


def test_shared_parameters_of_the_joint_surface_are_unpacked_as_they_were_packed():
    random = np.random.default_rng(0)
    lamps, gloss = random.random((joint_surface.OF_LAMP, 7)), random.random(joint_surface.OF_GLOSS)
    unpacked = joint_surface.unpack_shared(joint_surface.pack_shared(lamps, gloss), 7)
    np.testing.assert_array_equal(unpacked[0], lamps)
    np.testing.assert_array_equal(unpacked[1], gloss)
