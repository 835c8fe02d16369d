"""The rows of the table of formats that other programs have: see `hagoromo/files/format.py`."""

from __future__ import annotations

from hagoromo.files.format import Format
from hagoromo_formats.scenes.usd_stage import USD

VOLUMES = "hagoromo_formats.volumes"
CAMERAS = "hagoromo_formats.cameras"
SCENES = "hagoromo_formats.scenes"
MESHES = "hagoromo_formats.meshes"
REFLECTANCES = "hagoromo_formats.reflectances"
MESH, WRITE_MESH = "hagoromo.files.mesh:read_mesh", "hagoromo.files.mesh:write_mesh"
FORMATS = (
    Format(
        "NRRD", "volume", (".nrrd", ".nhdr"), f"{VOLUMES}.nrrd_file:read_nrrd", f"{VOLUMES}.volumes_out:nrrd",
        "pynrrd (its header)", "SimpleITK", "key/value pairs, colours, tensors; out: one field a file",
        magic=(b"NRRD",),
    ),
    Format(
        "MetaImage", "volume", (".mha", ".mhd"), f"{VOLUMES}.metaimage:read_metaimage", "", "our own", "SimpleITK",
        "anatomical names, tags, numbers as text, slices in several files",
    ),
    Format(
        "NIfTI", "volume", (".nii", ".nii.gz"), f"{VOLUMES}.nifti:read_nifti", "", "nibabel", "SimpleITK",
        "time, extensions, the second matrix",
    ),
    Format(
        "VTK image data", "volume", (".vti",), f"{VOLUMES}.vtk_images:read_vtk_image",
        f"{VOLUMES}.volumes_out:vti", "VTK (out: our own)", "VTK, our own bytes",
        "all arrays but one; out: spectra",
    ),
    Format(
        "SLC of VolVis", "volume", (".slc",), f"{VOLUMES}.vtk_images:read_vtk_image", "", "VTK", "our own bytes",
        "icons",
    ),
    Format(
        "Mitsuba grid volume", "volume", (".vol",), f"{VOLUMES}.mitsuba_volume:read_mitsuba_volume",
        f"{VOLUMES}.volumes_out:vol", "our own", "Mitsuba", "directions in bytes; out: all but one field",
        magic=(b"VOL\3",),
    ),
    Format(
        "NumPy array", "volume", (".npy",), f"{VOLUMES}.arrays:read_npy", "", "NumPy", "our own bytes",
        "nothing; lengths are not in it; pickles are refused",
        magic=(b"\x93NUMPY",),
    ),
    Format(
        "OpenVDB", "volume", (".vdb",), f"{VOLUMES}.openvdb:read_openvdb", f"{VOLUMES}.volumes_out:vdb",
        "our own (no wheel of OpenVDB exists)", "OpenVDB (Debian's pyopenvdb, skipped without), tinyvdb",
        "all grids but one; level sets, points, masks, maps of a camera are refused; out: spectra",
        magic=(b" BDV\0\0\0\0",), parts=True,
        look=f"{VOLUMES}.openvdb:look_at_openvdb",
    ),
    Format(
        "NanoVDB", "volume", (".nvdb",), f"{VOLUMES}.nanovdb:read_nanovdb", "", "our own",
        "OpenVDB's vdb_tool wrote it",
        "all grids but one; level sets, points and quantised numbers are refused",
        magic=(b"NanoVDB",), parts=True,
    ),
    Format(
        "HDF5", "volume", (".h5", ".hdf5"), f"{VOLUMES}.arrays:read_hdf5", "", "h5py", "NumPy",
        "attributes, other datasets",
        magic=(b"\x89HDF",), parts=True,
    ),
    Format(
        "RAW, lattice in its name", "volume", (".raw",), f"{VOLUMES}.arrays:read_raw_volume", "", "our own", "NumPy",
        "nothing; lengths are not in it",
    ),
    Format(
        "TIFF stack", "volume", (".tif", ".tiff"), f"{VOLUMES}.tiff_stack:read_tiff_stack", "", "tifffile, OpenCV",
        "Pillow", "tags but ImageJ's lengths; colours",
        sniff=f"{VOLUMES}.tiff_stack:is_stack",
    ),
    Format(
        "OpenCV YAML or JSON", "cameras", (".yml", ".yaml"), f"{CAMERAS}.opencv_file:read_opencv",
        f"{CAMERAS}.opencv_file:write_opencv", judge="OpenCV's FileStorage",
        lost="tilted and thin-prism lenses are refused", sniff=f"{CAMERAS}.opencv_file:is_opencv", key="opencv",
    ),
    Format(
        "Middlebury _par.txt", "cameras", (".txt",), f"{CAMERAS}.middlebury:read_middlebury",
        f"{CAMERAS}.middlebury:write_middlebury", judge="tests' own matrices", lost="size of the images, distortion",
        sniff=f"{CAMERAS}.middlebury:is_middlebury", key="middlebury",
    ),
    Format(
        "COLMAP", "cameras", ("", ".bin"), f"{CAMERAS}.colmap:read_colmap", f"{CAMERAS}.colmap:write_colmap",
        judge="tests' own bytes", lost="points and tracks", folder=True, sniff=f"{CAMERAS}.colmap:is_colmap",
        key="colmap",
    ),
    Format(
        "COLMAP, text", "cameras", ("", ".txt"), f"{CAMERAS}.colmap:read_colmap",
        f"{CAMERAS}.colmap:write_colmap_text", judge="tests' own bytes", lost="points and tracks", folder=True,
        sniff=f"{CAMERAS}.colmap:is_colmap", key="colmap-text",
    ),
    Format(
        "lensfun", "lens", (".xml",), f"{CAMERAS}.lensfun:names_in_lensfun", "", "lensfunpy",
        "its formulas in the tests", "vignetting, colour fringes; fisheyes are refused; the fit's residual is said",
        sniff=f"{CAMERAS}.lensfun:is_lensfun", facts=f"{CAMERAS}.lensfun:lens_facts",
    ),
    Format(
        "reflectance CSV", "reflectance", (".csv",), f"{REFLECTANCES}.table_csv:read_reflectance_csv", "", "csv",
        "our own reflectance", "columns of text are refused", sniff=f"{REFLECTANCES}.table_csv:is_reflectance_csv",
    ),
    Format(
        "MERL BRDF", "reflectance", (".binary",), f"{REFLECTANCES}.merl:read_merl", "", "our own",
        "our own reflectance in the published layout", "bins between those that are read; the sense of the plane",
    ),
    Format(
        "RGL BRDF", "reflectance", (".bsdf",), f"{REFLECTANCES}.rgl:read_rgl", f"{REFLECTANCES}.rgl_out:write_rgl",
        "Mitsuba, in a process of its own", "our own reflectance in the published layout; out: Mitsuba",
        "wavelengths between those that are read; the sense of the plane; out: all but planes", magic=(b"tensor_file",),
    ),
    Format(
        "VTK polygons", "surface", (".vtp",), MESH, "", "VTK", "tests' own text", "lines, points, data",
        triangles=f"{MESHES}.mesh_vtp:read_vtp", growth=60.0,
    ),
    Format(
        "Alembic", "surface", (".abc",), MESH, "", "alembic3d", "Blender wrote it, and the same as STL",
        "motion, UVs, materials; points and NURBS; curves but for hair; a subdivision surface is its cage",
        triangles=f"{MESHES}.mesh_abc:read_abc", growth=300.0,
    ),
    Format(
        "Mitsuba scene", "scene", ("", ".xml"), "hagoromo_formats.mitsuba.read:scene_from_mitsuba",
        "hagoromo_formats.mitsuba.write:write_mitsuba", "our own, nothing of it is run", "Mitsuba",
        "textures, instances, media; out: distortion, elements of planes and cylinders, shells of texels",
        sniff="hagoromo_formats.mitsuba.xml_tree:is_scene", facts="hagoromo_formats.mitsuba.xml_tree:scene_facts",
        as_scene="hagoromo_formats.mitsuba.read:scene_from_mitsuba",
    ),
    Format(
        "USD", "scene", USD, MESH, f"{SCENES}.usd_out:usd_from_scene", "usd-core, in a process of its own",
        "tinyusdz, the validators of usd-core; Blender",
        "files that are composed, textures but those of colour, gloss and normals, IES, motion of lamps, and by other "
        "than shifts and turns, instancers, cages' subdivision; "
        "out: volume boxes, maps of environments, distortion, profiles of lamps, spectra",
        facts=f"{SCENES}.usd_parts:usd_facts", as_scene=f"{SCENES}.usd_scene:scene_from_usd",
        triangles=f"{SCENES}.usd_parts:read_usd_mesh", mesh_writer=f"{SCENES}.usd_out:write_usd_mesh", growth=60.0,
        moves=True,
    ),
    Format(
        "glTF", "scene", (".glb", ".gltf"), MESH, f"{SCENES}.gltf_scene:gltf_from_scene",
        "trimesh (meshes), our own (cameras, lamps)", "VTK, tests' own bytes",
        "textures but those of base colour, roughness, specular and normals, metals by place, spectra, orthographic "
        "cameras; "
        "out: volume boxes, distortion, the optical axis, tails of facets", magic=(b"glTF",),
        as_scene=f"{SCENES}.gltf_scene:scene_from_gltf", mesh_writer=WRITE_MESH, growth=30.0,
    ),
)  # fmt: skip
