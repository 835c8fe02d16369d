"""The choices of a picture: how light is computed, and how shadows are."""

from typing import Literal, get_args

Mode = Literal["march", "full", "path"]
MODES: tuple[Mode, ...] = get_args(Mode)
Shadows = Literal["map", "march", "none"]
SHADOWS: tuple[Shadows, ...] = get_args(Shadows)
