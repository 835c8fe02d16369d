"""The rows of the table of formats that the core reads and writes: see `hagoromo/files/format.py`."""

from __future__ import annotations

from hagoromo.files.format import Format
from hagoromo.files.raw import RAW_SUFFIXES

VIEWS = "hagoromo.camera.formats"
INFO, PIXELS = "hagoromo.app.info", "hagoromo.app.pixel_facts"
MESH = "hagoromo.files.mesh:read_mesh"
WRITE_MESH = "hagoromo.files.mesh:write_mesh"
FORMATS = (
    Format(
        "capture", "cameras", ("",), "hagoromo.photograph.capture:load_capture",
        "hagoromo.photograph.capture:save_capture", lost="nothing", folder=True, sniff=f"{INFO}:is_capture",
        facts=f"{INFO}:transforms_facts",
    ),
    Format(
        "volume box", "box", (".zarr",), "hagoromo.volume.store.box_store:load_box",
        "hagoromo.volume.store.box_store:save_box", "zarr", "zarr", "nothing", folder=True, sniff=f"{INFO}:is_box",
        facts=f"{INFO}:box_facts",
    ),
    Format(
        "nerfstudio, instant-ngp, NeRF", "cameras", (".json",), f"{VIEWS}.camera_file:read_transforms_or_folder",
        f"{VIEWS}.nerfstudio:write_transforms", judge="tests' own transform",
        lost="fisheye lenses are refused; applied transforms, depth, partial scenes",
        sniff=f"{VIEWS}.camera_file:has_transforms", key="nerfstudio", facts=f"{INFO}:transforms_facts",
    ),
    Format(
        "OpenEXR", "picture", (".exr",), "hagoromo.files.exr:read_exr", "hagoromo.files.exr:write_exr",
        "our own (lines), OpenEXR (tiles, parts, all else, and out)", "OpenEXR, OpenImageIO",
        "all parts but the first, attributes but texts; out: deep pixels, colours beside linear sRGB",
        magic=(b"v/1\x01",), facts=f"{PIXELS}:exr",
    ),
    Format(
        "PNG", "picture", (".png",), "hagoromo.files.png:read_png", "hagoromo.files.png:write_png", "OpenCV",
        "Pillow, OpenImageIO",
        "`compare` and `convert` apply profiles of three primaries, photographs of captures none; pictures "
        "for people say that they are sRGB, or Display P3 (ICC; judged by LittleCMS)", magic=(b"\x89PNG",),
    ),
    Format(
        "Radiance HDR", "picture", (".hdr",), "hagoromo.files.hdr:read_hdr", "hagoromo.files.hdr:write_hdr", "OpenCV",
        "Mitsuba, our own bytes", "EXPOSURE and PRIMARIES; out: 8 bits of the brightest channel, what is below 0",
        facts=f"{PIXELS}:hdr",
    ),
    Format(
        "spectral EXR (Fichet et al.)", "picture", (".exr",), "hagoromo.image.picture.spectral_exr:read_spectral_exr",
        "hagoromo.image.picture.spectral_exr:write_spectral_exr", "as OpenEXR", "colour-science, OpenEXR",
        "polarisation, bispectral channels; out: one spectrum a pixel in place of the weights",
    ),
    Format(
        "JPEG", "picture", (".jpg", ".jpeg"), "hagoromo.files.picture:read_picture", "", "Pillow", "OpenCV",
        "colour profiles, as of PNG", magic=(b"\xff\xd8\xff",),
    ),
    Format(
        "TIFF", "picture", (".tif", ".tiff"), "hagoromo.files.tiff:read_tiff", "hagoromo.files.tiff:write_tiff",
        "tifffile, OpenCV", "Pillow, OpenImageIO",
        "all pages but the first; colour profiles, as of PNG", magic=(b"II*\0", b"MM\0*"), facts=f"{PIXELS}:tiff",
    ),
    Format(
        "camera RAW", "picture", RAW_SUFFIXES, "hagoromo.files.raw:read_raw", "", "rawpy", "tifffile", "notes",
        facts=f"{PIXELS}:raw",
    ),
    Format(
        "PLY", "surface", (".ply",), MESH, "", "trimesh", "Mitsuba", "colours", magic=(b"ply",),
        mesh_writer=WRITE_MESH, growth=40.0,
    ),
    Format(
        "Wavefront OBJ", "surface", (".obj",), MESH, "", "trimesh", "Mitsuba", "materials", mesh_writer=WRITE_MESH,
        growth=60.0,
    ),
    Format(
        "STL", "surface", (".stl",), MESH, "", "trimesh", "Blender wrote it, tests' own bytes", "colours",
        mesh_writer=WRITE_MESH, growth=30.0,
    ),
    Format(
        "OFF", "surface", (".off",), MESH, "", "trimesh", "tests' own text", "colours", mesh_writer=WRITE_MESH,
        growth=60.0,
    ),
    Format("scene, recipe, batch", "matter", (".toml",), "hagoromo.files.record:read_toml", "", "tomllib", "", "none"),
    Format(
        "materials, camera, lamps", "result", (".json",), "hagoromo.files.record:read_json", "", "msgspec", "json",
        "nothing", facts=f"{INFO}:json_facts",
    ),
    Format(
        "IES LM-63", "lamps", (".ies",), "hagoromo.light.lamp_profile:LampProfile.from_ies", "", "our own",
        "colour-science's file", "the shape of the luminaire", facts=f"{INFO}:ies_facts",
    ),
    Format(
        "RTI dome .lp", "lamps", (".lp",), "hagoromo.photograph.lamp_files:load_lamps",
        "hagoromo.photograph.lamp_files:write_lp", judge="tests' own text", lost="distances: lamps are far",
        facts=f"{INFO}:lamps_facts",
    ),
    Format(
        "IES TM-27-14", "spectrum", (".spdx", ".xml"), "hagoromo.light.spectrum:read_spectrum_file", "",
        "colour-science", "tests' own text", "header, bandwidth, uncertainty",
    ),
    Format(
        "SPD of PBRT and Mitsuba", "spectrum", (".spd",), "hagoromo.light.spectrum:read_spectrum_file", "",
        "our own", "Mitsuba", "comments",
    ),
    Format(
        "table or spectrum", "table", (".csv",), "hagoromo.files.table:read_table", "hagoromo.files.table:write_table",
        "csv", "NumPy", "columns of text are refused",
    ),
)  # fmt: skip
