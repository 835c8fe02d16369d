"""A good sample of a scene of Mitsuba: XML, with meshes beside it, one of them serialized."""

from __future__ import annotations

import struct
import tempfile
import zlib
from pathlib import Path
from typing import Any

from fuzz.meshes import CORNERS, TRIANGLES, ply

SCENE = """<scene version="3.0.0"><default name="w" value="24"/><integrator type="path"/>
<sensor type="thinlens"><float name="fov" value="45"/><float name="aperture_radius" value="0.01"/>
<float name="focus_distance" value="5"/><transform name="to_world"><lookat origin="0,0,5" target="0,0,0" up="0,1,0"/>
</transform><film type="hdrfilm"><integer name="width" value="$w"/><integer name="height" value="16"/></film></sensor>
<bsdf type="roughplastic" id="coat"><rgb name="diffuse_reflectance" value="0.2 0.3 0.4"/>
<float name="alpha" value="0.2"/>
</bsdf><bsdf type="twosided" id="both"><ref id="coat"/></bsdf>
<shape type="serialized"><string name="filename" value="a.serialized"/><integer name="shape_index" value="1"/>
<transform name="to_world"><rotate x="1" angle="30"/><scale value="2"/><translate z="-1"/></transform>
<ref id="both"/></shape>
<shape type="ply"><string name="filename" value="a.ply"/><bsdf type="diffuse"><spectrum name="reflectance"
value="400:0.1, 700:0.8"/></bsdf></shape>
<shape type="rectangle"><emitter type="area"><spectrum name="radiance" value="2"/></emitter></shape>
<emitter type="spot"><rgb name="intensity" value="#ffaa88"/><float name="cutoff_angle" value="30"/></emitter>
<emitter type="constant"><rgb name="radiance" value="1, 0.5, 0.2"/></emitter></scene>"""


def scene(folder: Path) -> None:
    """a.xml, a.serialized and a.ply."""
    (folder / "a.xml").write_text(SCENE)
    ply(folder / "a.ply")
    serialized(folder / "a.serialized")


def serialized(path: Path) -> None:
    """Two meshes of version 4."""
    head = struct.pack("<I", 0x1000) + b"mesh\0" + struct.pack("<QQ", len(CORNERS), len(TRIANGLES))
    body = zlib.compress(head + CORNERS.tobytes() + TRIANGLES.astype("<u4").tobytes())
    mesh = struct.pack("<HH", 0x041C, 4) + body
    path.write_bytes(mesh + mesh + struct.pack("<QQI", 0, len(mesh), 2))


def read(path: Path) -> Any:
    """The scene as ours, in a folder that goes away."""
    from hagoromo_formats.mitsuba.read import scene_from_mitsuba

    with tempfile.TemporaryDirectory() as folder:
        return scene_from_mitsuba(path, Path(folder) / "out")
