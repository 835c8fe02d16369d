"""Mitsuba's `volpath`, one scattering event: the matte sphere is a tabulated phase function of albedo π α.

Rays go through the middles of pixels, as everybody else's here; variant llvm_ad_mono (scalar_rgb takes as long).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import mitsuba as mi
import numpy as np
from numpy.typing import NDArray
from peers_scene import ALPHA, EYE, FOCAL, INTENSITY, PeerScene, sphere_phase

mi.set_variant("llvm_ad_mono")

SAMPLES = (1, 4, 16, 64, 256, 1024)  # paths a pixel
ANGLES = 361  # entries of the phase function over −1…1


class MiddleOfPixel(mi.Sensor):
    """A perspective camera with all rays of a pixel through its middle."""

    def __init__(self, properties: mi.Properties) -> None:
        super().__init__(properties)
        width, height = self.film().size()
        self.size = mi.ScalarVector2f(width, height)
        self.lens = mi.load_dict({"type": "perspective", **lens(), "film": film(width, height)})

    def sample_ray_differential(self, time: Any, wavelength: Any, position: Any, aperture: Any, active: Any) -> Any:  # pyrefly: ignore[bad-override-param-name]
        """A ray through the middle of the pixel that `position` (0…1) lies in."""
        middle = (mi.Point2f(mi.Point2u(position * self.size)) + 0.5) / self.size
        return self.lens.sample_ray_differential(time, wavelength, middle, aperture, active)


mi.register_sensor("middle_of_pixel", MiddleOfPixel)


def frames(scene: PeerScene) -> dict[str, Callable[[], NDArray]]:
    """Pictures (pixels, pixels) of 1, 4, 16, … paths a pixel."""
    ready = mi.load_dict(scene_dictionary(scene))

    def picture(samples: int) -> NDArray:
        return np.array(mi.render(ready, spp=samples))[..., 0]

    return {f"{samples} spp": lambda samples=samples: picture(samples) for samples in SAMPLES}


def scene_dictionary(scene: PeerScene) -> dict[str, Any]:
    """The study as Mitsuba describes scenes."""
    pixels = scene.study.pixels
    place = mi.ScalarTransform4f().translate([-1.0, -1.0, -1.0]).scale(2.0)
    described: dict[str, Any] = {
        "type": "scene",
        "integrator": {"type": "volpath", "max_depth": 2, "rr_depth": 1 << 20, "hide_emitters": True},
        "sensor": {"type": "middle_of_pixel", "film": film(pixels, pixels), "sampler": {"type": "independent"}},
        "box": {
            "type": "cube",
            "bsdf": {"type": "null"},
            "interior": {
                "type": "heterogeneous",
                "albedo": {"type": "constvolume", "value": math.pi * ALPHA},
                "scale": scene.tau,
                "sigma_t": {
                    "type": "gridvolume", "grid": mi.VolumeGrid(scene.density[..., None]), "to_world": place,
                    "raw": True,
                },
                "phase": phase_function(),
            },
        },
    }  # fmt: skip
    for number, lamp in enumerate(scene.lamps):
        intensity = {"type": "spectrum", "value": INTENSITY}
        described[f"lamp{number}"] = {"type": "point", "position": lamp.tolist(), "intensity": intensity}
    return described


def phase_function() -> dict[str, str]:
    """The matte sphere's; Mitsuba counts the angle from straight on, χ = ∠(L, V) from straight back."""
    values = sphere_phase(-np.linspace(-1.0, 1.0, ANGLES))
    return {"type": "tabphase", "values": ",".join(f"{value:.9g}" for value in values)}


def lens() -> dict[str, Any]:
    """The camera's place and field of view."""
    look = mi.ScalarTransform4f().look_at(EYE, [0.0, 0.0, 0.0], [0.0, 1.0, 0.0])
    return {
        "fov": 2.0 * math.degrees(math.atan(0.5 / FOCAL)), "to_world": look, "near_clip": 0.01, "far_clip": 100.0
    }  # fmt: skip


def film(width: int, height: int) -> dict[str, Any]:
    """A film that takes the mean of a pixel's rays."""
    kind = {"type": "hdrfilm", "pixel_format": "luminance", "component_format": "float32"}
    return kind | {"width": int(width), "height": int(height), "rfilter": {"type": "box"}}
