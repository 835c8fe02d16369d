"""Health: the checks of a capture in one record: what is good, what is doubtful and why, what cannot be tested."""

from __future__ import annotations

from typing import Annotated, Any, Literal, get_args

from msgspec.structs import asdict

from hagoromo.files.record import ForeignRecord, about, decode
from hagoromo.measurement.trials import Trials

State = Literal["good", "doubtful", "not testable"]
Name = Literal["order", "lamps", "strengths", "transfer", "motion", "blur", "mask", "calibration"]
NAMES: tuple[Name, ...] = get_args(Name)


class Check(ForeignRecord, frozen=True, kw_only=True):
    """One check of a capture."""

    name: Annotated[Name, about("what was checked")]
    state: Annotated[State, about("what came out")]
    said: Annotated[str, about("what was found, or why it cannot be tested")]
    advice: Annotated[str, about("what to do where it is doubtful")] = ""

    @property
    def sentence(self) -> str:
        """One line: `order: doubtful: photographs 3 and 7 are exchanged: give them in the order of the lamps`."""
        return ": ".join(part for part in (self.name, self.state, self.said, self.advice) if part)


class Health(ForeignRecord, frozen=True, kw_only=True):
    """The checks of a capture, one for each of NAMES, in their order."""

    checks: Annotated[tuple[Check, ...], about("one for each of NAMES, in their order")]

    def __getitem__(self, name: str) -> Check:
        """The check of that name."""
        return next(one for one in self.checks if one.name == name)

    @property
    def doubtful(self) -> tuple[Check, ...]:
        """What people must hear of."""
        return tuple(one for one in self.checks if one.state == "doubtful")

    def record(self) -> dict[str, Any]:
        """Plain values, as health.json has them."""
        return {"checks": [asdict(one) for one in self.checks]}

    @staticmethod
    def from_record(record: Any, where: str) -> Health:
        """What `record` gave, read from `where`."""
        return decode(record, Health, where)


def good(name: Name, said: str) -> Check:
    """A check that found nothing wrong."""
    return Check(name=name, state="good", said=said)


def doubtful(name: Name, said: str, advice: str) -> Check:
    """A check that found a fault."""
    return Check(name=name, state="doubtful", said=said, advice=advice)


def not_testable(name: Name, why: str) -> Check:
    """A check that these photographs do not allow."""
    return Check(name=name, state="not testable", said=why)


def good_where_noticed(name: Name, said: str, mistake: str, trials: Trials, hidden: str) -> Check:
    """Good where a mistake that was made on purpose was noticed often enough, not testable otherwise. mistake: what was
    done, and to what; hidden: what hides it.
    """
    if not trials.enough:
        rarely = f"{mistake} is noticed in {trials.noticed} of {trials.tried} trials only: {hidden}"
        return not_testable(name, rarely)
    return good(name, f"{said}; {mistake} is noticed in {trials.noticed} of {trials.tried} trials")
