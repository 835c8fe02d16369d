"""The scene file of a ball before one camera: the same for tests of commands and of files, and for crash points."""

from collections.abc import Iterable

SENSOR = "{exposure = 40000, full_well = 40000, read_noise = 5, gain = 10, bits = 12}"
BALL = """
[[surface]]
name = "ball"
shape = "sphere"
scale = 0.15
reflectance = {alpha = 0.2, beta = 0.5, gamma = 0.2, n = 1.5, body_colour = 0.8}
"""


def camera(size: tuple[int, int], focal: float = 90.0, response: str = "canon_eos_300d") -> str:
    """A camera at 1 m with a sensor; size, focal [px]."""
    return f"""
[camera]
size = [{size[0]}, {size[1]}]
focal = [{focal}, {focal}]
response = "{response}"
sensor = {SENSOR}
eye = [0.0, -1.0, 0.0]
"""


def lamp(name: str, *position: float, intensity: str = "intensity = 3.0\n") -> str:
    """A near lamp at a position [m]; without a name for ""."""
    named = f'name = "{name}"\n' if name else ""
    return f"\n[[lamp]]\n{named}position = {list(position)}\n{intensity}"


KEY, FILL = lamp("key", 0.5, -2.0, 1.0), lamp("fill", -0.7, -1.5, 0.5)


def ball_scene(
    size: tuple[int, int] = (61, 47),
    focal: float = 90.0,
    lamps: Iterable[str] = (KEY, FILL),
    response: str = "canon_eos_300d",
) -> str:
    """The TOML of the scene."""
    return camera(size, focal, response) + "".join(lamps) + BALL
