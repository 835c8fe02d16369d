"""VTK's volumetric shadows, which only vtkGPUVolumeRayCastMapper has: OpenGL, drawn by Mesa's llvmpipe without a GPU.

They come with an isotropic phase function only. Under one far lamp the phase function of a matte sphere is one factor
for every pixel, and the picture is multiplied by it.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray
from peers_scene import PeerScene, sphere_phase
from peers_vtk import picture, prepared
from vtkmodules.vtkRenderingVolume import vtkGPUVolumeRayCastMapper


def frames(scene: PeerScene) -> dict[str, Callable[[], NDArray]]:
    """The picture (pixels, pixels) with shadows of the whole volume."""
    mapper = vtkGPUVolumeRayCastMapper()
    mapper.UseJitteringOff()
    mapper.SetVolumetricScatteringBlending(2.0)  # no gradient shading mixed in
    mapper.SetGlobalIlluminationReach(1.0)
    window = prepared(scene, mapper, 1.0)
    phase = sphere_phase(-scene.directions @ scene.lamps[0]).astype(np.float32)
    return {f"step 0.5 voxel, {drawn_by(window)}": lambda: picture(window) * phase}


def drawn_by(window: Any) -> str:
    """Name of what draws, as OpenGL gives it."""
    window.Initialize()
    lines = window.ReportCapabilities().split("\n")
    return next(line.split(":", 1)[1].split("(")[0].strip() for line in lines if line.startswith("OpenGL renderer"))
