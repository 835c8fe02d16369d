"""What `hagoromo develop` prints: the noise of the sensor, its linearity, the exposures of a bracket."""

from __future__ import annotations

from hagoromo.photograph.development.development import Development


def development_summary(development: Development) -> list[str]:
    """Lines of text."""
    noise, record = development.noise, development.record()
    low, high = noise.gain_interval
    lines = [
        f"gain {noise.gain:.4g} ± {noise.gain_error:.2g} e⁻/DN ({low:.4g} to {high:.4g}), read noise "
        f"{noise.read_noise:.3g} ± {noise.read_error:.2g} e⁻, from {noise.source}",
        f"linearity {record['linearity']}; clipped {100 * development.clipped:.2g} %, "
        f"hot {100 * development.hot:.2g} % of samples",
    ]
    if development.blacks:
        added = ", ".join(
            f"{development.blacks[name]:+.2f} ± {development.black_errors[name]:.2f}" for name in development.blacks
        )
        lines.append(f"black: {added} DN added to the signals of the frames, by which they are proportional")
    for name, (x, y) in development.shifts.items():
        lines.append(f"{name}: exposed {development.exposures[name]:.6g} s, moved by ({x:.2f}, {y:.2f}) px")
    return lines
