"""Good samples of text and records: scenes, recipes, captures, cameras, lamps, materials, tables, drafts, profiles."""

# ruff: noqa: E501 - samples stay as files have them
from __future__ import annotations

import json
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import numpy as np

from fuzz import pictures
from hagoromo.files.record import write_json
from hagoromo.files.table import write_table
from hagoromo.reflectance.parameters import PLAIN_BODY

ROOT = Path(__file__).resolve().parents[1]
MOTION = """
[motion]
seconds = 2.0
frames_per_second = 12.0
[[motion.camera]]
time = 0.0
eye = [0.0, -1.0, 0.0]
target = [0.0, 0.0, 0.0]
[[motion.camera]]
time = 2.0
eye = [0.3, -1.0, 0.1]
[[motion.lamp]]
lamp = 0
time = 0.0
intensity = 1.0
spectrum = "A"
[[motion.lamp]]
lamp = 0
time = 2.0
spectrum = {wavelengths = [400, 700], values = [1.0, 0.5]}
"""
BODY_LAW = ", ".join(f"{key} = {plain + 0.05}" for key, plain in PLAIN_BODY.items())
SCENE = """
format_version = 1
camera = {size = [61, 47], focal = [90.0, 90.0], principal = [30.0, 23.0], distortion = [0.0, 0.0, 0.0, 0.0], \
binning = 1, response = "response.csv", eye = [0.0, -1.0, 0.0], target = [0.0, 0.0, 0.0], up = [0.0, 0.0, 1.0], name = "c", \
sensor = {exposure = 40000.0, full_well = 40000.0, read_noise = 5.0, gain = 10.0, bits = 12, mosaic = "RGGB"}}
lamp = [{name = "key", position = [0.5, -2.0, 1.0], intensity = 3.0, spectrum = "D65", axis = [0.0, 1.0, 0.0], \
axis_power = 2.0}, {name = "fill", to_lamp = [-0.7, -1.5, 0.5], intensity = [3.0, 2.0, 1.0], spectrum = \
{wavelengths = [400.0, 700.0], values = [1.0, 2.0]}}, {position = [0.0, -1.0, 1.0], profile = "lamp.ies", roll_deg = 10.0, \
candela_from_profile = true}, {position = [0.0, -1.0, 1.0], profile = {lateral = [0.0], vertical = [0.0, 90.0], \
intensity = [[1.0, 0.5]], peak_candela = 10.0}}]
surface = [{name = "ball", shape = "sphere", scale = 0.15, position = [0.0, 0.0, 0.1], rotation_deg = [0.0, 10.0, 0.0], \
reflectance = {alpha = 0.2, beta = 0.5, gamma = 0.2, n = 1.5, nu = 2.0, BODY_LAW, body_colour = {wavelengths = [400.0, 700.0], values = [0.2, 0.4]}, element = "plane"}}, \
{name = "glass", shape = "sphere", scale = 0.05, position = [0.3, 0.0, 0.1], optics = "glass", absorption = 2.0, reflectance = {alpha = 0.0, \
beta = 1.0, gamma = 0.1, n = 1.5, body_colour = 0.0}}, \
{mesh = "a.ply", scale = [1.0, 1.0, 2.0], smooth = false, reflectance = {file = "materials.json", material = "one"}}]
render = {samples = 4, shadows = "map", shadow_resolution = 64, tolerance = 0.04, seed = 0, separate_lamps = false}
""".replace("BODY_LAW", BODY_LAW)
IES = """IESNA:LM-63-2002
[TEST] 7
[LUMINAIRE] a flood
[MORE] with a lens
TILT=NONE
1 1000 2.0 4 3 1 2 0.1, 0.2,0
0.5 1.0 50
0 22.5
60,90
0 30 90
100 80 20 0
90 70 30 1
60 50 10 0.5
"""
WIF = """[WIF]
Version=1.1
[WEAVING]
Rising Shed=true
Shafts=4
Treadles=4
[WARP]
Threads=8
Units=centimeters
Spacing=0.08
Thickness=0.03
Color=1
[WEFT]
Threads=8
Color=2,1,1,1
[COLOR PALETTE]
Range=0,255
Entries=2
[COLOR TABLE]
1=255,255,255
2=10,20,30
[WARP COLORS]
3=2
[THREADING]
1=1
2=2
3=3
4=4
5=1
6=2
7=3
8=4
[TIEUP]
1=1,2
2=2,3
3=3,4
4=4,1
[TREADLING]
1=1
2=2
3=3
4=4
5=1
6=2
7=3
8=4
"""
PLY = """ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 1
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 3
"""
OBJ = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nvt 0 0\nvn 0 0 1\nf 1/1/1 2/1/1 3/1/1\nf 1 2 4\nf 1//1 3//1 4//1\n"
OBJ_OF_PARTS = OBJ.replace("f 1 2 4", "usemtl a b\nf 1 2 4") + "usemtl c\nf 2/1 3/1 4/1\n"
OFF = "OFF\n4 4 6\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n3 0 2 1\n3 0 1 3\n3 0 3 2\n3 1 2 3\n"


SPDX = """<?xml version="1.0" encoding="UTF-8"?>
<IESTM2714 xmlns="iestm2714" version="1.0"><Header><Manufacturer>a</Manufacturer><DocumentCreator>b</DocumentCreator>
<ReportDate>2020-01-01</ReportDate></Header><SpectralDistribution><SpectralQuantity>relative</SpectralQuantity>
<SpectralData wavelength="400.0">0.5</SpectralData><SpectralData wavelength="500.0">1.0</SpectralData>
<SpectralData wavelength="600.0">0.25</SpectralData></SpectralDistribution></IESTM2714>
"""


def text(content: str) -> Callable[[Path], None]:
    """Writes a text."""

    def write(path: Path) -> None:
        path.write_text(content, encoding="utf-8")

    return write


def response(path: Path) -> None:
    """Curves of three channels, with stated limits."""
    waves = np.arange(400.0, 701.0, 50.0)
    columns = {"wavelength_nm": waves} | {n: 0.1 + 0.1 * k + waves / 7000 for k, n in enumerate("RGB")}
    write_table(path, columns, "limits_nm = 400, 700")


def spectrum(path: Path) -> None:
    """A spectrum."""
    write_table(path, {"wavelength_nm": [400, 500, 600, 700], "value": [1, 2, 3, 2.5]})


def spectra(path: Path) -> None:
    """Reflectances of a prior."""
    columns = {name: [0.5, 0.2, 0.3, 0.1 * k] for k, name in enumerate("abcd")}
    write_table(path, {"wavelength_nm": [390, 500, 600, 710]} | columns)


def pairs(path: Path) -> None:
    """Spectra and readings."""
    random = np.random.default_rng(4)
    write_table(path, {name: random.random(7) for name in ("400", "450", "500", "600", "700", "R", "G")})


def curve(path: Path) -> None:
    """A transfer curve."""
    write_table(path, {"number": [0, 128, 255], "light": [0, 60, 255]})


def motion(folder: Path) -> None:
    """A scene that moves."""
    scene(folder)
    with (folder / "scene.toml").open("a") as file:
        file.write(MOTION)


LENSFUN = """<?xml version="1.0" encoding="utf-8"?>
<lensdatabase version="1"><mount><name>Acme</name></mount>
<camera><maker>Acme</maker><model>Acme One</model><mount>Acme</mount><cropfactor>1.5</cropfactor></camera>
<lens><maker>Acme</maker><model>Acme 20mm f/2</model><mount>Acme</mount><cropfactor>1.5</cropfactor>
<type>rectilinear</type><calibration>
<distortion model="ptlens" focal="20" a="0.01" b="-0.03" c="0.004"/>
<distortion model="poly5" focal="20.5" k1="0.01" k2="-0.003"/>
<tca model="linear" focal="20" kr="1.0001" kb="1.0002"/>
<vignetting model="pa" focal="20" aperture="2" distance="10" k1="-0.2" k2="0.1" k3="-0.05"/>
</calibration></lens></lensdatabase>
"""


def scene(folder: Path) -> None:
    """A scene with all the files that it names."""
    (folder / "scene.toml").write_text(SCENE)
    response(folder / "response.csv")
    (folder / "lamp.ies").write_text(IES)
    (folder / "a.ply").write_text(PLY)
    materials(folder / "materials.json")


def recipe(name: str) -> Callable[[Path], None]:
    """One of examples/recipes, with the drafts that are beside it."""
    return text((ROOT / "examples" / "recipes" / f"{name}.toml").read_text(encoding="utf-8"))


def mesh_recipe(folder: Path) -> None:
    """A solid of a mesh and a measured material."""
    record = {"form": "mesh", "file": "a.obj", "height_mm": 5.0, "rotation_deg": [0.0, 0.0, 10.0]}
    shape = ", ".join(f"{key} = {json.dumps(value)}" for key, value in record.items())
    material = 'material = {file = "materials.json", material = "one", element = "plane"}'
    (folder / "a.toml").write_text(f'kind = "solid"\nvoxel_mm = 0.5\nshape = {{{shape}}}\n{material}\n')
    (folder / "a.obj").write_text(OBJ)
    materials(folder / "materials.json")


def materials(path: Path) -> None:
    """One measured material."""
    bounds = {name: [0.1, None] for name in ("alpha", "beta", "gamma", "n", "specular_albedo")}
    colours = {"body_colour": [[0.1, 1.0]] * 3, "interface_colour": [[0.1, 1.0]] * 3}
    errors = {name: 0.1 for name in ("alpha", "beta", "gamma", "n", "nu", "specular_albedo")}
    record = {
        "name": "one", "pixels": 10, "body_colour": [1.0, 0.9, 1.1], "interface_colour": [1.0, 1.0, 1.0],
        "alpha": 0.2, "beta": 0.5, "gamma": 0.2, "nu": 2.0, "n": 1.5, "specular_albedo": 0.04, "element": "plane",
        "standard_error": errors | {"body_colour": [0.1] * 3, "interface_colour": None},
        "interval_95": bounds | colours | {"nu": [0.3, None]},
        "correlation": [[1.0, 0.1, None, 0.0]] * 4,
        "identifiable": {"alpha": True, "beta": True, "gamma": False, "n": False, "nu": True, "interface_colour": False},
        "chi_square": 1.0, "remarks": ["a remark"], "lack_of_fit": {"p": 0.5}, "texture": None, "gloss": None,
        "convergence": {"status": "converged", "steps": 4}, "hagoromo": {"format_version": 1, "settings": {"n": 1.5}},
    }  # fmt: skip
    write_json(path, [record])


def lamps(path: Path) -> None:
    """lamps.json with every key."""
    one = {"to_lamp": [0.0, 0.0, 1.0], "intensity": 1.0, "name": "a", "spectrum": "D65"}
    other = {"position": [0.0, 0.0, 1.0], "intensity": [1.0, 2.0, 3.0], "axis": [0.0, 0.0, -1.0], "axis_power": 1.0}
    ball = {"centre": [10.0, 11.0], "radius": 5.0}
    reading = {"name": "a", "standard_error_deg": 0.1, "intensity_from": "ball"}
    write_json(
        path,
        {"lamps": [one, other], "ball": ball, "balls": [ball], "spread": {"smallest": 0.3}, "readings": [reading] * 2,
         "object": None, "hagoromo": {"format_version": 1, "seed": 3}},
    )  # fmt: skip


def rig(path: Path) -> None:
    """rig.json with every key."""
    far = {"name": "a", "to_lamp": [0.0, 0.0, 1.0], "turn": [0.001, 0.0, 0.0], "turn_error": 0.001}
    near = {"name": "b", "position": [0.0, 0.0, 1.0]}
    both = {"strength": [1.0, 0.9, 1.1], "slope": [0.1, -0.1], "covariance": [[1e-4, 0.0, 0.0]] * 3}
    write_json(
        path,
        {"size": [64, 48], "sources": ["card"], "lamps": [far | both, near | both], "hagoromo": {"format_version": 1}},
    )


def camera(path: Path) -> None:
    """camera.json."""
    lens = {
        "w": 61,
        "h": 47,
        "fl_x": 90.0,
        "fl_y": 90.0,
        "cx": 30.0,
        "cy": 23.0,
        "k1": 0.1,
        "k2": 0.0,
        "p1": 0.0,
        "p2": 0.0,
    }
    more = {"standard_deviation": {"fl_x": 0.1}, "rms_px": 0.2, "boards_rms_px": {"a.png": 0.2}, "skipped": ["b.png"]}
    write_json(path, lens | more | {"outliers": [], "hagoromo": {"format_version": 1}})


def capture(folder: Path) -> None:
    """transforms.json with pictures, a mask, points and normals."""
    from hagoromo.files.exr import write_exr

    pictures.png(folder / "a.png")
    pictures.tiff(folder / "b.tif")
    pictures.mask(folder / "mask.png")
    response(folder / "response.csv")
    (folder / "lamp.ies").write_text(IES)
    for name, letter in (("points", "P"), ("normals", "N")):
        write_exr(folder / f"{name}.exr", {f"{letter}.{a}": np.ones((13, 17), np.float32) for a in "XYZ"})
    sensor = {"exposure": 4e4, "full_well": 4e4, "gain": 2.0, "read_noise": 5.0, "black_level": 0.0}
    pose = np.eye(4).tolist()
    frames = [
        {"file_path": "a.png", "name": "a", "lamps": [0], "exposure_s": 1.0, "iso": 100.0, "mask_path": "mask.png",
         "transfer": "srgb", "transform_matrix": pose, "fl_x": 20.0, "fl_y": 20.0, "cx": 8.5, "cy": 6.5, "k1": 0.0},
        {"file_path": "b", "lamps": [1], "pl_pos": [0.0, 0.0, 1.0], "transform_matrix": pose, "fl_x": 20.0,
         "camera_model": "OPENCV", "w": 17, "h": 13, "sensor": {"white_level": 60000.0, "bits": 16}},
    ]  # fmt: skip
    lamps = [
        {"to_lamp": [0.0, 0.0, 1.0], "intensity": 1.0, "spectrum": "D65"},
        {"position": [0.0, 0.0, 1.0], "profile": "lamp.ies", "intensity": 2.0, "roll_deg": 3.0},
    ]
    top = {"name": "c", "sensor": sensor | {"response": "response.csv"}, "lamps": lamps, "truth": {"scene": "a.toml"}}
    paths = {"points_path": "points.exr", "normals_path": "normals.exr"}
    write_json(folder / "transforms.json", {"hagoromo": {"settings": {}, "seed": 1}, **top, **paths, "frames": frames})


def views(folder: Path, kind: str, name: str) -> None:
    """Two views in a format of another program."""
    from hagoromo.camera.camera import Camera
    from hagoromo.camera.formats.camera_file import write_views

    lens = Camera(17, 13, (20.0, 21.0), (8.0, 6.0), (0.1,) + (0.0,) * 7 if kind != "middlebury" else (0.0,) * 8)
    turned = np.array([[0, 0, 1, 1], [1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]], float)
    posed = {"a.png": lens.with_pose(np.eye(4)), "b.png": lens.with_pose(turned)}
    write_views(folder / name, posed, kind)  # type: ignore[arg-type]
    pictures.png(folder / "a.png")


def points(folder: Path, binary: bool) -> None:
    """Points of a COLMAP model."""
    import struct

    if binary:
        row = struct.pack("<Q3d3BdQ4i", 7, 0.1, 0.2, 0.3, 1, 2, 3, 0.5, 2, 1, 1, 2, 1)
        (folder / "points3D.bin").write_bytes(struct.pack("<Q", 2) + row + row)
    else:
        (folder / "points3D.txt").write_text("# 3D points\n7 0.1 0.2 0.3 255 0 9 0.75 1 1\n")


def measured(folder: Path) -> None:
    """A measurement on disk: materials, labels, normals, points, body, gloss, separation, variance, own light, spectra."""
    from hagoromo.files.exr import write_exr
    from hagoromo.files.png import write_png

    materials(folder / "materials.json")
    one = np.full((5, 7), 0.5, np.float32)
    write_png(folder / "labels.png", np.ones((5, 7), np.uint8))
    for name, letter in (("points", "P"), ("normals", "N")):
        write_exr(folder / f"{name}.exr", {f"{letter}.{a}": one for a in "XYZ"})
    write_exr(folder / "body.exr", {prefix + c: one for prefix in ("", "error.") for c in "RGB"})
    write_exr(folder / "variance.exr", {"normal": one, "distance": one})
    write_exr(folder / "gloss.exr", {name: one for name in ("beta", "gamma", "error.beta", "error.gamma")})
    write_exr(folder / "separation_01.exr", {f"{part}.{c}": one for part in ("body", "interface") for c in "RGB"})
    write_exr(folder / "own_light.exr", {"share": one, "most": one})
    own = {"unit": {"value": 1.0, "standard_error": None}, "albedo": 0.5, "subtracted": False}
    room = {"value": None, "standard_error": None, "separate": False}
    write_json(folder / "own_light.json", {"own_light": own | {"light_of_the_room": room}})
    entry = {
        "name": "one",
        "wavelengths": [400.0, 500.0, 700.0],
        "values": [0.2, 0.3, 0.4],
        "standard_error": [0.1] * 3,
    }
    more = {"covariance": np.eye(3).tolist(), "probability": {"surfaces": 1.0}, "hagoromo": {}}
    write_json(folder / "body_spectra.json", [entry | more])


def calibrated_response(folder: Path) -> None:
    """Curves, and their intervals beside."""
    response(folder / "a.csv")
    waves = np.arange(400.0, 701.0, 50.0)
    ends = {f"{c}_{end}": waves / 7000 for c in "RGB" for end in ("low", "high")}
    write_table(folder / "a_interval.csv", {"wavelength_nm": waves} | ends)


def relief_recipe(folder: Path) -> None:
    """The skin of a measured surface."""
    (folder / "measured").mkdir()
    measured(folder / "measured")
    from hagoromo.files.exr import write_exr

    row, column = np.mgrid[:5, :7].astype(np.float32)
    places = {"P.X": 0.01 * column - 0.03, "P.Y": 0.01 * row - 0.02, "P.Z": np.full((5, 7), 1.0, np.float32)}
    write_exr(folder / "measured" / "points.exr", places)
    write_exr(folder / "measured" / "normals.exr", {f"N.{a}": np.full((5, 7), -(a == "Z"), np.float32) for a in "XYZ"})
    lens = {
        "w": 7,
        "h": 5,
        "fl_x": 100.0,
        "fl_y": 100.0,
        "cx": 3.5,
        "cy": 2.5,
        "k1": 0.0,
        "k2": 0.0,
        "p1": 0.0,
        "p2": 0.0,
    }
    write_json(folder / "camera.json", lens | {"rms_px": 0.2})
    (folder / "a.toml").write_text('kind = "relief"\nmeasured = "measured"\ncamera = "camera.json"\ndim = 0.5\n')


def points_file(path: Path) -> None:
    """Points that are counted from a place far out."""
    from hagoromo.photograph.pixels import write_points

    write_points(path, 1000.0 + 0.01 * np.random.default_rng(1).random((5, 7, 3)))


def lamps_of_balls(path: Path) -> None:
    """lamps.json of two lamps, from photographs of two balls."""
    import hagoromo as hg
    from hagoromo.files.png import write_png
    from tests.inverse.simulated_mirror import mask_of, mirror_photograph, seen_through

    lens = {"w": 151, "h": 101, "fl_x": 205.0, "fl_y": 205.0, "cx": 75.0, "cy": 50.0}
    seen = hg.Camera(151, 101, (205.0, 205.0), (75.0, 50.0))
    places = [np.array([-0.2, 0.02, 1.0]), np.array([0.2, -0.03, 1.1])]
    balls = [seen_through(seen, place, 0.08) for place in places]
    with tempfile.TemporaryDirectory() as scratch:
        home = Path(scratch)
        for k, ball in enumerate(balls):
            write_png(home / f"mask{k}.png", mask_of(ball))
        write_json(home / "camera.json", lens | dict.fromkeys(("k1", "k2", "p1", "p2"), 0.0))
        for k in range(2):
            write_png(home / f"{k}.png", mirror_photograph(balls, (0.3, -0.5 * k, 0.1), k, 0.06, position=True))
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            masks = [home / "mask0.png", home / "mask1.png"]
            found = hg.calibrate_lamps(
                [home / "0.png", home / "1.png"], masks, radius=0.08, camera=home / "camera.json"
            )
    found.save(path, True)


BATCH = """
format_version = 1
each = "captures/*.json"

[[step]]
name = "model"
verb = "convert"
arguments = ["{path}"]
options = { to = "colmap", window = [1, 2.5] }
out = "models/{name}"

[[step]]
name = "all"
verb = "relight"
arguments = ["{model}"]
options = { hold = ["a", "b"], n = 1.5, rig = "a.toml" }
out = "all/{name}"

[[step]]
name = "once"
verb = "render"
arguments = ["scene.toml", "--samples", "2"]
options = { separate-lamps = true, tolerance = 0.1 }
out = "once.exr"
"""


def batch(folder: Path) -> None:
    """A batch of two steps over two files."""
    (folder / "batch.toml").write_text(BATCH)
    (folder / "captures").mkdir()
    for name in "ab":
        camera(folder / "captures" / f"{name}.json")
    (folder / "scene.toml").write_text(SCENE)
    (folder / "a.toml").write_text("a = 1\n")


def lab_kept(path: Path) -> None:
    """What the window of the laboratory keeps of a folder."""
    made = {"capture": {"words": ["capture", "a.jpg", "--out", "lab/capture"], "read": "0" * 64}}
    kept = {"order": ["b.jpg", "a.jpg"], "circles": [[10.0, 20.0, 5.5]], "options": {"publish.title": "Vase"}}
    write_json(path, {**kept, "corners": [[1.0, 2.0], [9.0, 2.0], [9.0, 8.0], [1.0, 8.0]], "made": made})


def read_lab_kept(path: Path) -> None:
    """As the window reads it, in a folder of two photographs, and what it shows of it."""
    from hagoromo_page.lab.folder import RECORD, Folder
    from hagoromo_page.lab.steps import TABLE

    with tempfile.TemporaryDirectory() as name:
        home = Path(name)
        (home / RECORD).parent.mkdir()
        (home / RECORD).write_bytes(path.read_bytes())
        for photograph in ("a.jpg", "b.jpg"):
            (home / photograph).touch()
        folder = Folder(home)
        for step in TABLE:
            step.shown(folder)
            step.state(folder)


def lab_message(path: Path) -> None:
    """A message of its page."""
    write_json(path, {"do": "stroke", "paints": "object", "radius": 3.5, "points": [[1.0, 2.0], [3.0, 4.5]]})


def read_lab_message(path: Path) -> None:
    """As the window takes it."""
    from hagoromo.files.record import decode_one, read_json
    from hagoromo_page.lab.messages import MESSAGES

    decode_one(read_json(path), MESSAGES, str(path))
