"""Terms of the photometric model: a file each, and a line here that registers it."""

from collections.abc import Sequence

from hagoromo.errors import InputError
from hagoromo.measurement.photometric.term import Term
from hagoromo.measurement.photometric.terms.glare import GLARE

TERMS: tuple[Term, ...] = (GLARE,)


def terms_named(names: Sequence[str]) -> tuple[Term, ...]:
    """The terms of these names, in the order of the table. `InputError` for a name that no term has."""
    known = {term.name: term for term in TERMS}
    for name in names:
        if name not in known:
            raise InputError(f"{name!r} cannot be estimated: give one of {', '.join(known) or '(there are none)'}")
    return tuple(term for term in TERMS if term.name in names)
