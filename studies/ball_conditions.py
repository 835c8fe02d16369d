"""Conditions of simulated photographs of balls: what lamp, lens, surface and room do to them, by name."""

from __future__ import annotations

from dataclasses import dataclass

Range = tuple[float, float]


@dataclass(frozen=True)
class BallCondition:
    """What the photographs suffer from: ranges of uniform draws, of white unless stated.

    over: logarithm to base 10 of the lamp's light. lamp_deg: half width of the lamp. scratches, dust, streaks: how
    many; streaks run from the lamp to one side. wings, spikes: shares of the light that the lens spreads. second:
    highlights that stand still, and their light. room: light of what the lamp shines on and the ball mirrors. body:
    diffuse light of a ball that is no mirror; fresnel: what it mirrors towards the front, 1 for chrome; gloss: standard
    deviation of its slopes [rad]. defocus: radius [px].
    """

    over: Range = (0.2, 1.3)
    lamp_deg: Range = (1.0, 4.0)
    scratches: tuple[int, int] = (0, 0)
    scratch_light: Range = (0.05, 2.0)
    dust: tuple[int, int] = (0, 0)
    streaks: tuple[int, int] = (0, 0)
    streak_light: Range = (0.2, 1.0)
    wings: Range = (0.01, 0.05)
    spikes: Range = (0.0, 0.0)
    second: tuple[int, int] = (0, 0)
    second_light: Range = (0.5, 3.0)
    room: Range = (0.0, 0.1)
    defocus: Range = (0.0, 0.5)
    body: Range = (0.0, 0.0)
    fresnel: float = 1.0
    gloss: Range = (0.0, 0.0)
    jpeg: bool = False


CHROME = {
    "clean": BallCondition(),
    "spikes": BallCondition(over=(0.5, 2.3), spikes=(0.02, 0.12)),
    "streaks": BallCondition(over=(0.2, 2.0), streaks=(1, 4)),
    "scratched": BallCondition(over=(0.2, 2.0), scratches=(10, 60)),
    "dusty": BallCondition(over=(0.2, 2.0), dust=(20, 120)),
    "second": BallCondition(over=(0.5, 2.0), second=(1, 2)),
    "worn": BallCondition(
        over=(0.2, 2.3), lamp_deg=(0.7, 5.0), scratches=(5, 40), dust=(5, 60), streaks=(0, 2), streak_light=(0.1, 0.8),
        wings=(0.01, 0.1), spikes=(0.0, 0.06), second=(0, 1), second_light=(0.3, 2.0), room=(0.0, 0.3),
        defocus=(0.0, 1.2), jpeg=True,
    ),
}  # fmt: skip
GLOSSY = {
    "black plastic": BallCondition(over=(-1.0, 1.0), body=(0.0, 0.03), fresnel=0.04, gloss=(0.01, 0.05), jpeg=True),
    "white plastic": BallCondition(over=(-0.3, 1.0), body=(0.35, 0.9), fresnel=0.04, gloss=(0.01, 0.05), jpeg=True),
    "glazed": BallCondition(
        over=(-0.3, 1.0), scratches=(0, 10), scratch_light=(0.05, 0.5), dust=(0, 20), body=(0.1, 0.6), fresnel=0.05,
        gloss=(0.02, 0.08), jpeg=True,
    ),
}  # fmt: skip
