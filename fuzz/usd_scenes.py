"""A good sample of a USD scene, as text: units, cameras, lamps, meshes, materials, an instance; or in an archive."""

from __future__ import annotations

import tempfile
import zipfile
from pathlib import Path
from typing import Any

import numpy as np

SCENE = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
)
def RenderSettings "settings" { int2 resolution = (400, 200)
}
def Camera "eye" {
    float focalLength = 50
    float horizontalAperture = 25
    float verticalAperture = 12.5
    float horizontalApertureOffset = 2.5
    float fStop = 4
    float focusDistance = 300
    float2 clippingRange = (1, 1000)
    double3 xformOp:translate = (0, 50, 300)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def DistantLight "sun" {
    float inputs:intensity = 3
    float inputs:exposure = 1
    bool inputs:normalize = true
    double xformOp:rotateX = -90
    uniform token[] xformOpOrder = ["xformOp:rotateX"]
}
def DistantLight "disc" { float inputs:intensity = 1000
    float inputs:angle = 1
}
def SphereLight "point" { float intensity = 5
    float radius = 10
    bool treatAsPoint = true
    double3 xformOp:translate = (0, 200, 100)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def SphereLight "spot" (prepend apiSchemas = ["ShapingAPI"]) {
    float inputs:intensity = 5
    float inputs:shaping:cone:angle = 40
    float inputs:shaping:cone:softness = 0.5
}
def SphereLight "bulb" { float inputs:intensity = 7
    float inputs:radius = 5
}
def RectLight "panel" { float inputs:intensity = 8
    bool inputs:normalize = true
    float inputs:width = 20
    float inputs:height = 40
}
def DomeLight "sky" { float inputs:intensity = 0.25
}
def Material "red" {
    token outputs:surface.connect = </red/s.outputs:surface>
    def Shader "s" { uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor = (0.8, 0.1, 0.1)
        float inputs:roughness = 0.4
        token outputs:surface
   
}
}
def Material "clear" {
    token outputs:surface.connect = </clear/s.outputs:surface>
    def Shader "s" { uniform token info:id = "UsdPreviewSurface"
        float inputs:opacity = 0
        float inputs:roughness = 0
        float inputs:ior = 1.33
        token outputs:surface
   
}
}
def Xform "room" {
    double3 xformOp:translate = (100, 0, 0)
    double3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    def Mesh "table" (prepend apiSchemas = ["MaterialBindingAPI"]) {
        rel material:binding = </red>
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 0, 1, 4]
        point3f[] points = [(0, 0, 0), (10, 0, 0), (10, 0, 10), (0, 0, 10), (0, 10, 0)]
   
}
}
def Sphere "ball" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </clear>
    double radius = 10
    double3 xformOp:translate = (0, 50, 0)
    uniform token[] xformOpOrder = ["xformOp:translate"]
}
def Cube "box" { color3f[] primvars:displayColor = [(0.4, 0.4, 0.4)]
    double size = 20
}
def "again" (instanceable = true
    references = </room>) {}
def Cone "cone" {}
def Mesh "hidden" { token visibility = "invisible"
}
"""


def scene(path: Path) -> None:
    """As text."""
    path.write_text(SCENE)


def scene_binary(path: Path) -> None:
    """As a crate."""
    from hagoromo.files.reading import library

    layer = library("pxr.Sdf").Layer.CreateAnonymous(".usda")
    layer.ImportFromString(SCENE)
    layer.Export(str(path))


def scene_archive(path: Path) -> None:
    """As an archive, with a picture for the colour of a material."""
    from hagoromo.files.png import png_bytes

    connected = """color3f inputs:diffuseColor.connect = </red/map.outputs:rgb>
    }
    def Shader "map" { uniform token info:id = "UsdUVTexture"
        asset inputs:file = @maps/a.png@
        float3 outputs:rgb
    }
    def Shader "rest" {"""
    uvs = 'texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0, 1), (2, 0)] (interpolation = "vertex")\n'
    text = SCENE.replace("color3f inputs:diffuseColor = (0.8, 0.1, 0.1)", connected)
    text = text.replace("int[] faceVertexCounts", f"{uvs}int[] faceVertexCounts")
    with zipfile.ZipFile(path, "w") as out:
        out.writestr("a.usda", text)
        out.writestr("maps/a.png", png_bytes(np.arange(12, dtype=np.uint8).reshape(2, 2, 3)))


def read(path: Path) -> Any:
    """The scene as ours, in a folder that goes away."""
    from hagoromo_formats.scenes.usd_scene import scene_from_usd

    with tempfile.TemporaryDirectory() as folder:
        return scene_from_usd(path, Path(folder) / "out")
