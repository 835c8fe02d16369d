"""A body that highlights hide is refused in one line that names the photograph that would help."""

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.measurement.material.uncertainty import values_at
from hagoromo.measurement.parameters import pack_theta


def test_a_body_hidden_by_its_highlight_asks_for_another_lamp():
    theta = pack_theta(np.array([-0.02, -0.03, -0.04]), 0.5, 0.1, 1.5)
    with pytest.raises(InputError, match=r"reflects nothing \(α = -0.03\).*add one whose lamp"):
        values_at(theta)
