"""Table: every file format that is read or written, by what reads it, who checks that, and what is lost.

`info`, `convert`, their messages and the page of formats go by it.
"""

from __future__ import annotations

from hagoromo.camera.formats.camera_file import COLMAP, MIDDLEBURY, NERFSTUDIO, OPENCV
from hagoromo.files.format import Format
from hagoromo.files.raw import RAW_SUFFIXES
from hagoromo.files.usd_stage import USD
from hagoromo.files.volumes.formats import VOLUMES

VIEWS = "hagoromo.camera.formats"
READ_VIEWS = f"{VIEWS}.camera_file:read_views"
CAMERAS = (
    Format(
        NERFSTUDIO, "cameras", (".json",), READ_VIEWS, f"{VIEWS}.nerfstudio:write_transforms",
        judge="tests' own transform", lost="fisheye lenses are refused; applied transforms, depth, partial scenes",
    ),
    Format(
        OPENCV, "cameras", (".yml", ".yaml"), READ_VIEWS, f"{VIEWS}.opencv_file:write_opencv",
        judge="OpenCV's FileStorage", lost="tilted and thin-prism lenses are refused",
    ),
    Format(
        COLMAP, "cameras", ("", ".bin"), READ_VIEWS, f"{VIEWS}.colmap:write_colmap", judge="tests' own bytes",
        lost="points and tracks", folder=True,
    ),
    Format(
        MIDDLEBURY, "cameras", (".txt",), READ_VIEWS, f"{VIEWS}.middlebury:write_middlebury",
        judge="tests' own matrices", lost="size of the images, distortion",
    ),
)  # fmt: skip
PICTURES = (
    Format(
        "OpenEXR", "picture", (".exr",), "hagoromo.files.exr:read_exr", "hagoromo.files.exr:write_exr",
        "our own (lines), OpenEXR (tiles, parts, all else, and out)", "OpenEXR, OpenImageIO",
        "all parts but the first, attributes but texts; out: deep pixels, colours beside linear sRGB",
    ),
    Format(
        "PNG", "picture", (".png",), "hagoromo.files.png:read_png", "hagoromo.files.png:write_png", "OpenCV",
        "Pillow, OpenImageIO",
        "`compare` and `convert` apply profiles of three primaries, photographs of captures none; pictures "
        "for people say that they are sRGB, or Display P3 (ICC; judged by LittleCMS)",
    ),
    Format(
        "Radiance HDR", "picture", (".hdr",), "hagoromo.files.hdr:read_hdr", "hagoromo.files.hdr:write_hdr", "OpenCV",
        "Mitsuba, our own bytes", "EXPOSURE and PRIMARIES; out: 8 bits of the brightest channel, what is below 0",
    ),
    Format(
        "spectral EXR (Fichet et al.)", "picture", (".exr",), "hagoromo.image.spectral_exr:read_spectral_exr",
        "hagoromo.image.spectral_exr:write_spectral_exr", "as OpenEXR", "colour-science, OpenEXR",
        "polarisation, bispectral channels; out: one spectrum a pixel in place of the weights",
    ),
    Format(
        "JPEG", "picture", (".jpg", ".jpeg"), "hagoromo.files.picture:read_picture", "", "Pillow", "OpenCV",
        "colour profiles, as of PNG",
    ),
    Format(
        "TIFF", "picture", (".tif", ".tiff"), "hagoromo.files.tiff:read_tiff", "hagoromo.files.tiff:write_tiff",
        "tifffile, OpenCV", "Pillow, OpenImageIO",
        "all pages but the first; colour profiles, as of PNG",
    ),
    Format("camera RAW", "picture", RAW_SUFFIXES, "hagoromo.files.raw:read_raw", "", "rawpy", "tifffile", "notes"),
)  # fmt: skip
MESH, WRITE_MESH = "hagoromo.files.mesh:read_mesh", "hagoromo.app.formats.surfaces_out:write_surface"
MITSUBA = "Mitsuba scene"
SURFACES = (
    Format("PLY", "surface", (".ply",), MESH, WRITE_MESH, "trimesh", "Mitsuba", "colours"),
    Format("Wavefront OBJ", "surface", (".obj",), MESH, WRITE_MESH, "trimesh", "Mitsuba", "materials"),
    Format("STL", "surface", (".stl",), MESH, WRITE_MESH, "trimesh", "Blender wrote it, tests' own bytes", "colours"),
    Format("VTK polygons", "surface", (".vtp",), MESH, "", "VTK", "tests' own text", "lines, points, data"),
    Format(
        "Alembic",
        "surface",
        (".abc",),
        MESH,
        "",
        "alembic3d",
        "Blender wrote it, and the same as STL",
        "motion, UVs, materials; points and NURBS; curves but for hair; a subdivision surface is its cage",
    ),
    Format("OFF", "surface", (".off",), MESH, WRITE_MESH, "trimesh", "tests' own text", "colours"),
    Format(
        MITSUBA,
        "scene",
        (".xml",),
        "hagoromo.mitsuba.read:scene_from_mitsuba",
        "hagoromo.mitsuba.write:write_mitsuba",
        "our own, nothing of it is run",
        "Mitsuba",
        "textures, instances, media; out: distortion, elements of planes and cylinders, shells of texels",
    ),
    Format(
        "USD",
        "scene",
        USD,
        MESH,
        "hagoromo.app.formats.usd_out:usd_from_scene",
        "usd-core, in a process of its own",
        "tinyusdz, the validators of usd-core; Blender",
        "files that are composed, textures but those of colour and gloss, IES, motion, instancers, cages' subdivision; "
        "out: volume boxes, maps of environments, distortion, profiles of lamps, spectra",
    ),
    Format(
        "glTF",
        "scene",
        (".glb", ".gltf"),
        MESH,
        "hagoromo.app.formats.gltf_scene:gltf_from_scene",
        "trimesh (meshes), our own (cameras, lamps)",
        "VTK, tests' own bytes",
        "textures but those of base colour, roughness and specular, metals by place, spectra, orthographic cameras; "
        "out: volume boxes, distortion, the optical axis, tails of facets",
    ),
)
OTHERS = (
    Format(
        "volume box", "box", (".zarr",), "hagoromo.volume.store.box_store:load_box",
        "hagoromo.volume.store.box_store:save_box", "zarr", "zarr", "nothing", folder=True,
    ),
    Format("scene, recipe, batch", "matter", (".toml",), "hagoromo.files.record:read_toml", "", "tomllib", "", "none"),
    Format(
        "capture", "cameras", ("",), "hagoromo.photograph.capture:load_capture",
        "hagoromo.photograph.capture:save_capture", lost="nothing", folder=True,
    ),
    Format(
        "materials, camera, lamps", "result", (".json",), "hagoromo.files.record:read_json", "", "msgspec", "json",
        "nothing",
    ),
    Format(
        "lensfun", "lens", (".xml",), f"{VIEWS}.lensfun:names_in_lensfun", "", "lensfunpy", "its formulas in the tests",
        "vignetting, colour fringes; fisheyes are refused; the fit's residual is said",
    ),
    Format(
        "IES LM-63", "lamps", (".ies",), "hagoromo.light.lamp_profile:LampProfile.from_ies", "", "our own",
        "colour-science's file", "the shape of the luminaire",
    ),
    Format(
        "RTI dome .lp", "lamps", (".lp",), "hagoromo.photograph.lamp_files:load_lamps",
        "hagoromo.photograph.lamp_files:write_lp", judge="tests' own text", lost="distances: lamps are far",
    ),
    Format(
        "IES TM-27-14", "spectrum", (".spdx", ".xml"), "hagoromo.light.spectrum_file:read_spectrum_file", "",
        "colour-science", "tests' own text", "header, bandwidth, uncertainty",
    ),
    Format(
        "SPD of PBRT and Mitsuba", "spectrum", (".spd",), "hagoromo.light.spectrum_file:read_spectrum_file", "",
        "our own", "Mitsuba", "comments",
    ),
    Format(
        "table or spectrum", "table", (".csv",), "hagoromo.files.table:read_table", "hagoromo.files.table:write_table",
        "csv", "NumPy", "columns of text are refused",
    ),
)  # fmt: skip
FORMATS = (*VOLUMES, *CAMERAS, *PICTURES, *SURFACES, *OTHERS)


def suffixes(*holds: str) -> str:
    """The suffixes of what is read, of formats that hold one of `holds` (none: of all), for messages."""
    return ", ".join(
        dict.fromkeys(
            suffix for each in FORMATS if each.reader and (not holds or each.holds in holds) for suffix in each.suffixes
            if suffix
        )
    )  # fmt: skip
