"""VTK's ray caster for CPUs, vtkFixedPointVolumeRayCastMapper: shaded by the gradient, lamps far away, no shadows.

Steps of half a voxel, opacity 1 − exp(−σΔ) from a table; the picture is read from the window, 8 bits a channel.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import vtkmodules.vtkRenderingOpenGL2
import vtkmodules.vtkRenderingVolumeOpenGL2  # noqa: F401  (both register what draws here)
from numpy.typing import NDArray
from peers_scene import ALPHA, EYE, FOCAL, VOXEL, PeerScene
from vtkmodules.util.numpy_support import numpy_to_vtk, vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray
from vtkmodules.vtkCommonDataModel import vtkImageData, vtkPiecewiseFunction
from vtkmodules.vtkRenderingCore import vtkLight, vtkRenderer, vtkRenderWindow, vtkVolume, vtkVolumeProperty
from vtkmodules.vtkRenderingVolume import vtkFixedPointVolumeRayCastMapper

STEP = 0.5 * VOXEL
LEVELS = 32767  # the fixed-point mapper's tables are 15 bits long


def frames(scene: PeerScene) -> dict[str, Callable[[], NDArray]]:
    """The picture (pixels, pixels)."""
    mapper = vtkFixedPointVolumeRayCastMapper()
    mapper.SetInteractiveSampleDistance(STEP)
    window = prepared(scene, mapper, ALPHA)
    return {"step 0.5 voxel": lambda: picture(window)}


def prepared(scene: PeerScene, mapper: Any, intensity: float) -> Any:
    """A window that shows the study by `mapper`, with lamps of the given intensity."""
    mapper.SetSampleDistance(STEP)
    mapper.AutoAdjustSampleDistancesOff()
    mapper.SetImageSampleDistance(1.0)
    densest = float(scene.density.max())
    mapper.SetInputData(grid(scene.density / densest))
    volume = vtkVolume()
    volume.SetMapper(mapper)
    volume.SetProperty(look(scene.tau * densest))
    renderer = vtkRenderer()
    renderer.AutomaticLightCreationOff()
    renderer.AddVolume(volume)
    for to_lamp in scene.lamps:
        light = vtkLight()
        light.SetLightTypeToSceneLight()
        light.SetPosition(*to_lamp)
        light.SetFocalPoint(0.0, 0.0, 0.0)
        light.SetIntensity(intensity)
        renderer.AddLight(light)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*EYE)
    camera.SetFocalPoint(0.0, 0.0, 0.0)
    camera.SetViewUp(0.0, 1.0, 0.0)
    camera.SetViewAngle(2.0 * math.degrees(math.atan(0.5 / FOCAL)))
    renderer.ResetCameraClippingRange()
    window = vtkRenderWindow()
    window.SetOffScreenRendering(True)
    window.SetMultiSamples(0)
    window.SetSize(scene.study.pixels, scene.study.pixels)
    window.AddRenderer(renderer)
    return window


def grid(density: NDArray) -> Any:
    """Densities 0…1 as 15-bit integers, which the mapper reads without conversion."""
    image = vtkImageData()
    image.SetDimensions(*density.shape[::-1])
    image.SetSpacing(VOXEL, VOXEL, VOXEL)
    image.SetOrigin(*(VOXEL / 2.0 - 1.0,) * 3)
    image.GetPointData().SetScalars(numpy_to_vtk(np.round(density * LEVELS).astype(np.uint16).ravel(), deep=True))
    return image


def look(extinction: float) -> Any:
    """Grey matter: opacity of a step by density, lit by the diffuse part alone."""
    opacity, grey = vtkPiecewiseFunction(), vtkPiecewiseFunction()
    for part in np.linspace(0.0, 1.0, 1025):
        opacity.AddPoint(part * LEVELS, 1.0 - math.exp(-extinction * part * STEP))
    grey.AddPoint(0.0, 1.0)
    grey.AddPoint(LEVELS, 1.0)
    matter = vtkVolumeProperty()
    matter.SetScalarOpacity(opacity)
    matter.SetScalarOpacityUnitDistance(STEP)
    matter.SetColor(grey)
    matter.SetInterpolationTypeToLinear()
    matter.DisableGradientOpacityOn()
    matter.ShadeOn()
    matter.SetAmbient(0.0)
    matter.SetDiffuse(1.0)
    matter.SetSpecular(0.0)
    return matter


def picture(window: Any) -> NDArray:
    """Render and read the red channel: (pixels, pixels), 0…1."""
    window.Render()
    width, height = window.GetSize()
    read = vtkUnsignedCharArray()
    window.GetPixelData(0, 0, width - 1, height - 1, 0, read, 0)
    return vtk_to_numpy(read).reshape(height, width, 3)[::-1, :, 0] / np.float32(255.0)
