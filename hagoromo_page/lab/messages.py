"""Messages: what the page may ask for, each kind a record that is checked when it arrives."""

from __future__ import annotations

from typing import Annotated, Literal

from msgspec import Meta

from hagoromo.files.record import Record, about, up_to
from hagoromo_page.lab.folder import MOST_BALLS, Circle, Corner, Name, Radius, Text

MOST_POINTS = 5000  # of a stroke: some hundred seconds of a moving hand
Way = Annotated[str, Meta(max_length=4096)]


class Open(Record, frozen=True, tag_field="do", tag="open"):
    """Choose a folder."""

    folder: Annotated[Way, about("the way from the folder that the window was started with")]


class Choose(Record, frozen=True, tag_field="do", tag="choose"):
    """Choose the value of an option of a step."""

    step: Name
    option: Name
    value: Text


class Swap(Record, frozen=True, tag_field="do", tag="swap"):
    """Exchange two photographs in the order of their lamps."""

    names: tuple[Name, Name]


class Reverse(Record, frozen=True, tag_field="do", tag="reverse"):
    """Reverse the order of the photographs."""


class AsNamed(Record, frozen=True, tag_field="do", tag="as named"):
    """The order of the photographs is that of their names again."""


class Circles(Record, frozen=True, tag_field="do", tag="circles"):
    """The circles of the chrome balls; none: they are found."""

    circles: Annotated[list[Circle], up_to(MOST_BALLS)]


class SetCorners(Record, frozen=True, tag_field="do", tag="corners"):
    """The corners of the chart, clockwise from that of the first patch; none: they are found."""

    corners: Annotated[list[Corner], up_to(4)]

    def __post_init__(self) -> None:
        if len(self.corners) not in (0, 4):
            raise ValueError(f"corners must be four, or none: given {len(self.corners)}")


class Stroke(Record, frozen=True, tag_field="do", tag="stroke"):
    """A stroke over the mask, in pixels of the photographs."""

    paints: Annotated[Literal["object", "background", "as found"], about("what lies under the stroke")]
    radius: Radius
    points: Annotated[list[Corner], Meta(min_length=1, max_length=MOST_POINTS)]


class ClearMask(Record, frozen=True, tag_field="do", tag="clear mask"):
    """What was painted is removed."""


class SetProfile(Record, frozen=True, tag_field="do", tag="profile"):
    """Who archives, as `archive` takes it by --profile."""

    values: Annotated[dict[Name, Text], Meta(max_length=16)]


class Run(Record, frozen=True, tag_field="do", tag="run"):
    """Run a step, with those before it that are not done. replace: whether what is there may be replaced."""

    step: Name
    replace: bool = False


class Cancel(Record, frozen=True, tag_field="do", tag="cancel"):
    """End the command that runs."""


MESSAGES = (Open, Choose, Swap, Reverse, AsNamed, Circles, SetCorners, Stroke, ClearMask, SetProfile, Run, Cancel)
LARGEST_BODY = 1 << 18  # bytes: a stroke of MOST_POINTS has some 100 KB
