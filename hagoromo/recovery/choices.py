"""Choices: the words by which a recovery is asked for what nobody measured."""

from typing import Literal

Light = Literal["auto", "even", "object", "camera"]  # what unknown light is fixed to
Refine = Literal["auto", "cameras", "none"]  # what is estimated beside the object
