"""Stage: the measured surface of a capture as the recipe of a volume box, for scenes under any lamp."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import write_views
from hagoromo.camera.response import Response, camera_white, white_of
from hagoromo.errors import InputError
from hagoromo.files.toml_text import toml_text
from hagoromo.files.whole import write_text
from hagoromo.light.lamp import Lamp, common_spectrum
from hagoromo.light.spectrum import Spectrum, smooth_rgb_basis
from hagoromo.matter.relief.relief import Relief, read_relief, surface_reflectances
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.transforms import record_from_lamp
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.spectra.body_basis import body_basis

RELIEF_RECIPE = "relief.toml"
RAYS_PER_PIXEL = 4  # rays a pixel
# One, through its middle, of a pixel whose normal was solved in this view: normal and lobe have in them what varies
# within the pixel, and rays beside its middle, under normals between those of pixels, would count that twice.
RAYS_PER_SOLVED_PIXEL = 1
MARCH_TOLERANCE = 0.01  # of the march: shadow maps of an opaque skin are then within 2 % of it, see `Settings`
# Bands inside those of `smooth_rgb_basis`: a camera whose channels read its coefficients.
BASIS_BANDS_NM = ((620.0, 700.0), (530.0, 555.0), (400.0, 460.0))  # nm
COLOURS = 3
LEAST_DIM = 1e-6  # least `dim` that is tried: a reflectance that does not conserve energy even then is refused


@dataclass(frozen=True, eq=False, repr=False)
class Stage:
    """The measured surface as the recipe of a volume box.

    relief, materials: of the surface. camera: of the photographs that were measured. spectrum: of their lamps; None
    where that or the response of the camera is not known: body colours are then on one basis spectrum per channel.
    dim: factor that makes the reflectances of the recipe conserve energy; lamps are divided by it. solved: whether the
    normals were solved from the photographs, rather than given.
    """

    relief: Relief
    materials: tuple[MaterialEstimate, ...]
    camera: Camera
    spectrum: Spectrum | None
    dim: float
    solved: bool = False

    def __repr__(self) -> str:
        height, width = self.relief.labels.shape
        return f"Stage({width} × {height} px, {len(self.materials)} materials, dim {self.dim:g})"

    def was_measured_in(self, camera: Camera) -> bool:
        """Whether `camera` has the view of the photographs that were measured."""
        same_size = (camera.height, camera.width) == self.relief.labels.shape
        return same_size and np.allclose(camera.matrix, self.camera.matrix, rtol=1e-6)

    def write_scene(self, photograph: Photograph, number: int, home: Path) -> Path:
        """Write the scene of a photograph, and the response of its camera, to the folder `home`; its path."""
        camera = photograph.camera
        response = basis_camera() if self.spectrum is None else camera.response
        if response is None:
            raise InputError(
                f"photograph {photograph.name!r} is of a camera of unknown response, unlike those that were measured: "
                "give its response"
            )
        response.write_table(home / f"response_{number:02d}.csv")
        scene = {
            "camera": {
                "size": [camera.width, camera.height], "focal": list(camera.focal),
                "principal": list(camera.principal), "distortion": list(camera.distortion),
                "world_to_camera": camera.world_to_camera.ravel().tolist(), "response": f"response_{number:02d}.csv",
            },
            "lamp": [self._lamp(lamp, camera.response) for lamp in photograph.lamps],
            "box": [{"recipe": RELIEF_RECIPE}],
            "render": {
                "samples": RAYS_PER_SOLVED_PIXEL if self.solved and self.was_measured_in(camera) else RAYS_PER_PIXEL,
                "tolerance": MARCH_TOLERANCE,
            },
        }  # fmt: skip
        path = home / f"scene_{number:02d}.toml"
        write_text(path, toml_text(scene))
        return path

    def write_into(self, home: Path) -> None:
        """Write the recipe of the volume box, with its camera and response, to the folder `home`."""
        write_views(home / "camera.json", {"photograph": self.camera}, "nerfstudio")
        recipe: dict[str, Any] = {"kind": "relief", "measured": "measured", "camera": "camera.json", "dim": self.dim}
        if self.spectrum is not None:
            assert self.camera.response is not None  # as the spectrum is known
            self.camera.response.write_table(home / "response.csv")
            recipe |= {"response": "response.csv", "lamp": self.spectrum.record()}
        write_text(home / RELIEF_RECIPE, toml_text(recipe))

    def _lamp(self, lamp: Lamp, response: Response | None) -> dict[str, Any]:
        """The record of a lamp, divided by `dim`; without a known spectrum, one band of light for each channel."""
        if self.spectrum is not None:
            if isinstance(lamp.intensity, tuple):
                raise InputError(
                    f"lamp {lamp.name!r} has an intensity per channel, the measured lamps have a spectrum: give one"
                )
            return record_from_lamp(replace(lamp, intensity=lamp.intensity / self.dim))
        reads = np.broadcast_to(lamp.intensity, 3) * white_of(lamp.spectrum, response, 3)
        knots = [(w, value) for band, value in zip(BASIS_BANDS_NM[::-1], reads[::-1], strict=True) for w in band]
        return record_from_lamp(replace(lamp, intensity=1.0 / self.dim, spectrum=Spectrum(*zip(*knots, strict=True))))


def make_stage(capture: Capture, measured: Path, solved: bool = False) -> Stage:
    """The stage of the surface that `Measurement.write_into` wrote to the folder `measured`, of `capture`.

    solved: whether its normals were solved from the photographs.

    capture: of three channels, see `in_three_channels`.
    """
    camera = capture.photographs[0].camera
    spectrum = _spectrum(capture)
    relief, materials = read_relief(measured)
    basis = smooth_rgb_basis() if spectrum is None else body_basis(camera.response, spectrum)
    dim = 1.0
    while dim > LEAST_DIM and not _conserves_energy(materials, basis, dim):
        dim *= 0.5
    return Stage(relief, materials, camera, spectrum, dim, solved)


def in_three_channels(capture: Capture) -> Capture:
    """The capture; grey photographs as three channels alike, of three times the variance: together they count as one.

    A response of one channel becomes a factor on the strengths of lamps. `InputError` for other than one or three.
    """
    channels = capture.photographs[0].values.shape[2]
    if channels not in (1, COLOURS):
        raise InputError(f"relight takes photographs of one channel or of three: these have {channels}")
    return capture if channels == COLOURS else replace(capture, photographs=tuple(map(_grey, capture.photographs)))


def _grey(photograph: Photograph) -> Photograph:
    """A photograph of one channel as one of three."""
    response = photograph.camera.response
    lamps = []
    for lamp in photograph.lamps:
        white = float(white_of(lamp.spectrum, response, 1)[0])
        lamps.append(
            replace(lamp, intensity=white * float(np.ravel(lamp.intensity)[0]), spectrum=Spectrum.constant(1.0))
        )
    native = photograph.native
    return replace(
        photograph,
        values=np.repeat(photograph.values, COLOURS, axis=2),
        variance=COLOURS * np.repeat(photograph.variance, COLOURS, axis=2),
        native=None if native is None else np.repeat(native, COLOURS, axis=2),
        camera=replace(photograph.camera, response=None),
        lamps=tuple(lamps),
    )


def basis_camera() -> Response:
    """A camera whose values are the coefficients of `smooth_rgb_basis`; white is 1."""
    wavelengths = np.arange(400.0, 700.5, 0.5)
    bands = np.stack([(wavelengths > low) & (wavelengths < high) for low, high in BASIS_BANDS_NM], axis=1).astype(
        np.float64
    )
    bands /= camera_white(Spectrum.constant(1.0), Response(wavelengths, bands))
    return Response(wavelengths, bands, name="basis")


def _spectrum(capture: Capture) -> Spectrum | None:
    """The common spectrum of all lamps; None if there is none, or the camera's response is unknown."""
    known = all(photograph.camera.response is not None for photograph in capture.photographs)
    return common_spectrum([lamp for p in capture.photographs for lamp in p.lamps]) if known else None


def _conserves_energy(materials: Sequence[MaterialEstimate], basis: Sequence[Spectrum], dim: float) -> bool:
    """Whether the materials, times `dim`, conserve energy."""
    try:
        surface_reflectances(materials, basis, dim)
    except InputError:
        return False
    return True
