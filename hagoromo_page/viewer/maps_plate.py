"""Maps plate: what a measurement found of each pixel, with its uncertainty, under a lamp that is moved."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hagoromo.camera.response import camera_white, srgb_from_camera
from hagoromo.measurement.inspection.map_files import end_of_curvature, end_of_occlusion
from hagoromo.measurement.inspection.profile import HeightProfile, profile
from hagoromo.measurement.inspection.seen_surface import SeenSurface, seen_surface
from hagoromo.measurement.measurement import Measurement
from hagoromo_page.publication.closely import CloseLook
from hagoromo_page.publication.lit import reflected
from hagoromo_page.publication.surface_maps import SurfaceMaps
from hagoromo_page.viewer.plates import (
    LARGEST_NOISE,
    Picture,
    PlateLight,
    as_bytes,
    in_colours,
    in_two_colours,
    numbered,
    scaled,
    three_channels,
)
from hagoromo_page.viewer.probe import NOISE_OF_95, WAVELENGTHS, Probe, with_spectrum
from hagoromo_page.viewer.view_state import ViewTransform

LARGEST_TILT_DEG = 5.0  # standard error of a normal [°] that is shown brightest
OF_NORMALS = f"uncertainty of normals, 0…{LARGEST_TILT_DEG:g}°"
OF_BODY = f"uncertainty of body, 0…{100 * LARGEST_NOISE:g} %"
OF_CURVATURE = "curvature: grooves blue, ridges red"
OF_SKY, OF_STRETCH = "occlusion: sky that is open", "stretched colours"
OF_GAMMA = f"uncertainty of γ, 0…{100 * LARGEST_NOISE:g} %"


class MapsPlate:
    """The maps of a measurement, lit by a far lamp that is moved; without cast shadows."""

    lamps: tuple[str, ...] = ()
    turns = True

    def __init__(self, maps: SurfaceMaps, measurement: Measurement, look: CloseLook | None = None) -> None:
        self.maps, self.measurement, self.look = maps, measurement, look
        self.size = (maps.labels.shape[1], maps.labels.shape[0])
        self._surface: SeenSurface | None = None  # of the whole measurement, once heights are asked for
        optional = {
            "depth": maps.depth, "β interface": maps.beta, "γ roughness": maps.gamma, "1/ν tails": maps.tail,
            OF_NORMALS: maps.normal_error, OF_BODY: maps.body_error,
            OF_GAMMA: maps.gloss_error, OF_CURVATURE: maps.curvature, OF_SKY: maps.occlusion,
            OF_STRETCH: None if look is None else look.stretch,
        }  # fmt: skip
        self.layers = ("picture", "body", "normals", "material", *(k for k, v in optional.items() if v is not None))

    @property
    def cover(self) -> Picture:
        """See `Plate`."""
        return self.maps.known.astype(np.float32)

    def part(self, rows: slice, columns: slice, size: tuple[int, int]) -> MapsPlate:
        """See `Plate`."""
        cut = self.maps.part(rows, columns)
        width = cut.labels.shape[1]
        return MapsPlate(cut.reduced(width / size[0]) if size[0] < width else cut, self.measurement, self.look)

    def linear(self, layer: str, light: PlateLight, development: ViewTransform) -> Picture | None:
        """See `Plate`."""
        if layer == "body":
            return self._to_srgb(three_channels(np.pi * self.maps.body))
        if layer != "picture":
            return None
        x, y = light.towards
        z = np.sqrt(max(1.0 - x * x - y * y, 1e-4))
        return self._to_srgb(reflected(self.maps, np.array([x, y, z]) / np.linalg.norm((x, y, z))))

    def coded(self, layer: str) -> Picture:
        """See `Plate`. Normals: 0.5 + 0.5 n, x right, y up, z to the camera."""
        maps, known = self.maps, self.maps.known
        if layer == "normals":
            return as_bytes(np.where(known[..., None], 0.5 + 0.5 * maps.normals, 0.0))
        if layer == "material":
            return numbered(maps.labels + 1)
        if layer in (OF_CURVATURE, OF_SKY, OF_STRETCH):
            return self._closely(layer)
        scales = {
            OF_NORMALS: (maps.normal_error, np.radians(LARGEST_TILT_DEG)),
            OF_BODY: (maps.body_error, LARGEST_NOISE),
            OF_GAMMA: (maps.gloss_error, LARGEST_NOISE),
        }
        if layer in scales:
            values, most = scales[layer]
            assert values is not None
            return in_colours(values / most, known)
        maps_of = {"depth": maps.depth, "β interface": maps.beta, "γ roughness": maps.gamma, "1/ν tails": maps.tail}
        values = maps_of[layer]
        assert values is not None
        return scaled(values, known)

    def _closely(self, layer: str) -> Picture:
        """Curvature, occlusion or stretched colours, in the scales of a published page."""
        maps, look = self.maps, self.look
        assert look is not None and maps.curvature is not None and maps.occlusion is not None
        if layer == OF_STRETCH:
            assert look.stretch is not None
            return look.stretch.picture(maps.body, maps.known)
        if layer == OF_SKY:
            dark = end_of_occlusion(look.occlusion)
            return scaled(np.clip(maps.occlusion, dark, 1.0), maps.known)
        return in_two_colours(maps.curvature / end_of_curvature(look.curvature), np.isfinite(maps.curvature))

    def probe(self, x: float, y: float, light: PlateLight) -> Probe:
        """See `Plate`. The spectrum is that of the body, of its material, with its 95 % band."""
        maps = self.maps
        column, row = int(x * self.size[0]), int(y * self.size[1])
        label = int(maps.labels[row, column])
        pixel = np.asarray(self._to_srgb(three_channels(np.pi * maps.body))[row, column])
        found = Probe(column, row, self.size, np.full(len(WAVELENGTHS), np.nan), pixel, float(label >= 0))
        if label < 0:
            return found
        material = maps.materials[label]
        said = [repr(material).partition("(")[2].removesuffix(")")]
        for values, what, factor, unit in (
            (maps.depth, "depth", 1e3, " mm"),
            (maps.beta, "β", 1.0, "/sr"),
            (maps.gamma, "γ", 180.0 / np.pi, "°"),
            (maps.tail, "1/ν", 1.0, ""),
            (maps.curvature, "curvature", 1.0, "" if self.look is None else f"/{self.look.unit}"),
            (maps.occlusion, "open sky", 100.0, " %"),
        ):
            if values is not None:
                said.append(f"{what} {factor * values[row, column]:.4g}{unit}")
        if maps.normal_error is not None:
            said.append(f"normal ± {NOISE_OF_95 * np.degrees(maps.normal_error[row, column]):.2f}° (95 %)")
        known = self.measurement.body_spectra.get(material.name)
        if known is None:
            return replace(found, said=(*said, "no spectrum: the camera's response or the lamp's is not known"))
        share = np.pi * float(maps.body[row, column].mean())  # body spectra are of mean 1 over the channels
        return replace(with_spectrum(found, known, share), said=(*said, "spectrum: reflectance of the body, 95 % band"))

    def heights(self, start: Probe, end: Probe) -> HeightProfile:
        """Heights along the line between two probes, as `hagoromo profile` gives them; `InputError` as that."""
        if self._surface is None:
            self._surface = seen_surface(self.measurement)
        places = [(one.column + 0.5 + self.maps.x, one.row + 0.5 + self.maps.y) for one in (start, end)]
        return profile(self._surface, *places)

    def _to_srgb(self, values: Picture) -> Picture:
        """Linear sRGB of camera values under its lamps; of an unknown response as they are."""
        taken = self.measurement.photographed_with
        response = None if taken is None else taken.camera.response
        if response is None or len(response.channels) != 3 or taken is None or not taken.lamps:
            return values
        lamp = taken.lamps[0].spectrum
        return values @ (srgb_from_camera(response, lamp) * camera_white(lamp, response)).T
