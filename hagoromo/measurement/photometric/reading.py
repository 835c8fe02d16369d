"""Reading: the value of a pixel over the irradiance of its lamp, Tanaka eq. (2), for every fit.

    value_c = a_c B + e_c I

a_c = α c_b is the body colour, e_c the colour of the interface; B and I are what the geometry of pixel, lamp and eye
gives for a body and an interface of 1, times the light. The value is linear in (B, I): so its slope by anything that
they depend on (normal, lamp, width of the lobe) is the same expression of their slopes.
"""

from __future__ import annotations

from typing import Any


def reading(body: Any, lit: Any, colour: Any, interface: Any) -> Any:
    """a B + e I; or its slope, for slopes of `lit` B and `interface` I. colour: e, None for 1.

    All are floats, NumPy or Dr.Jit arrays alike, of shapes that broadcast. Value per irradiance [1/sr], or in the unit
    of the light that B and I are times.
    """
    return body * lit + (interface if colour is None else colour * interface)
