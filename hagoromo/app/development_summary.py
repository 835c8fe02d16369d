"""What `hagoromo develop` prints: the noise of the sensor, its linearity, the exposures of a bracket."""

from __future__ import annotations

from hagoromo.photograph.development.development import Development


def development_summary(development: Development) -> list[str]:
    """Lines of text."""
    noise, record = development.noise, development.record()
    lines = [
        f"gain {noise.gain:.4g} ± {noise.gain_error:.2g} e⁻/DN, read noise {noise.read_noise:.3g} ± "
        f"{noise.read_error:.2g} e⁻, from {noise.source}",
        f"linearity {record['linearity']}; clipped {100 * development.clipped:.2g} %, "
        f"hot {100 * development.hot:.2g} % of samples",
    ]
    if development.black_offset:
        lines.append(f"black: {development.black_offset:+.2f} DN added to all signals, by which they are proportional")
    for name, (x, y) in development.shifts.items():
        lines.append(f"{name}: exposed {development.exposures[name]:.6g} s, moved by ({x:.2f}, {y:.2f}) px")
    return lines
