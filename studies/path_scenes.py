"""Captures of a scanned mesh for `recover`, lit by Mitsuba's path tracer.

Its gloss is not ours, and one part of the object throws light onto another.

It is glossy plastic, GGX facets over a body of three smooth patterns of colour (Mitsuba's `principled`).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.backend import mitsuba, vectors
from studies.recover_scenes import DISTANCE, RADIUS, Shots, Simulated, TrueObject, photograph_of

Array = NDArray[np.float64]
ROUGHNESS, INDEX = 0.18, 1.5  # GGX width α, and of the plastic
MOST_BOUNCES, WALKS = 8, 256  # of light, and for each pixel


def scanned(file: Path) -> Any:
    """A mesh of Mitsuba's, of RADIUS about the origin, with colours of its vertices."""
    import trimesh

    mesh = trimesh.load_mesh(file)
    points = np.asarray(mesh.vertices, np.float64)
    low, high = points.min(axis=0), points.max(axis=0)
    points = (points - 0.5 * (low + high)) * (2.0 * RADIUS / float((high - low).max()))
    return _mesh(points, mesh.faces, patterns(points), glossy=True)


def shape_mesh(truth: TrueObject, voxel: float = 0.0005) -> Any:
    """A matt mesh of Mitsuba's of an exact shape, with the body colours of its vertices."""
    from skimage.measure import marching_cubes

    edge = np.arange(-1.3 * RADIUS, 1.3 * RADIUS, voxel)
    z, y, x = np.meshgrid(edge, edge, edge, indexing="ij")
    distance = np.array(truth.distance(vectors(np.stack([x, y, z], axis=3).reshape(-1, 3)))).reshape(x.shape)
    corners, faces, _, _ = marching_cubes(distance, 0.0)
    points = corners[:, ::-1] * voxel + edge[0]
    return _mesh(points, faces, np.stack([np.array(each) for each in truth.colours(vectors(points))], axis=1), False)


def _mesh(points: Array, faces: Any, colours: Array, glossy: bool) -> Any:
    """A mesh of Mitsuba's with colours of its vertices."""
    mi = mitsuba()
    colour, properties = {"type": "mesh_attribute", "name": "vertex_color"}, mi.Properties()
    bsdf = {"type": "principled", "roughness": float(np.sqrt(ROUGHNESS)), "eta": INDEX, "base_color": colour}
    plain = {"type": "twosided", "material": {"type": "diffuse", "reflectance": colour}}
    properties["bsdf"] = mi.load_dict(bsdf if glossy else plain)
    made = mi.Mesh("scan", len(points), len(faces), properties, has_vertex_normals=False, has_vertex_texcoords=False)
    parameters = mi.traverse(made)
    parameters["vertex_positions"] = points.astype(np.float32).ravel()
    parameters["faces"] = np.asarray(faces, np.uint32).ravel()
    parameters.update()
    made.add_attribute("vertex_color", 3, colours.astype(np.float32).ravel())
    return made


def patterns(points: Array) -> Array:
    """Body colours (n, 3) at points [m]: three smooth patterns."""
    x, y, z = points.T
    return np.stack(
        [
            0.5 + 0.2 * np.sin(150.0 * x + 2.0) * np.cos(110.0 * z),
            0.46 + 0.18 * np.sin(170.0 * y) * np.cos(90.0 * x + 1.0),
            0.44 + 0.22 * np.cos(130.0 * z + 60.0 * x),
        ],
        axis=1,
    )


def path_simulated(mesh: Any, taken: Shots, seed: int = 0, noise: bool = True) -> Simulated:
    """Photographs of a mesh, one for each view and lamp."""
    random, exact = np.random.default_rng(seed), []
    photographs: list[hg.Photograph] = []
    focal = taken.focal * taken.pixels
    plain = hg.Camera(taken.pixels, taken.pixels, (focal, focal), (0.5 * taken.pixels, 0.5 * taken.pixels))
    for view, lamps in zip(taken.views, taken.lamps, strict=True):
        camera = plain.look_at(tuple(DISTANCE * view), (0.0, 0.0, 0.0))
        for place in lamps:
            lamp = hg.Lamp(position=place, intensity=np.pi * float(place @ place))
            light, share = traced(mesh, camera, lamp, seed + len(photographs))
            exact.append(light)
            photographs.append(photograph_of(light, share, camera, lamp, random if noise else None, len(photographs)))
    return Simulated(hg.Capture(tuple(photographs), "scan"), exact)


def traced(mesh: Any, camera: hg.Camera, lamp: hg.Lamp, seed: int) -> tuple[Array, Array]:
    """Light (h, w, 3) of all bounces, and the share of each pixel that the mesh covers."""
    mi = mitsuba()

    to_world = np.linalg.inv(camera.world_to_camera) @ np.diag([-1.0, -1.0, 1.0, 1.0])  # x to the left, y up
    scene = mi.load_dict(
        {
            "type": "scene", "integrator": {"type": "path", "max_depth": MOST_BOUNCES}, "mesh": mesh,
            "lamp": {
                "type": "point", "position": [float(x) for x in lamp.place],
                "intensity": {"type": "rgb", "value": [float(np.mean(lamp.intensity))] * 3},
            },
            "sensor": {
                "type": "perspective", "fov_axis": "x", "to_world": mi.ScalarTransform4f(to_world),
                "fov": float(np.degrees(2.0 * np.arctan(0.5 * camera.width / camera.focal[0]))),
                "film": {
                    "type": "hdrfilm", "width": camera.width, "height": camera.height, "pixel_format": "rgba",
                    "rfilter": {"type": "box"},
                },
                "sampler": {"type": "independent", "sample_count": WALKS},
            },
        }
    )  # fmt: skip
    image = np.array(mi.render(scene, seed=seed), np.float64)
    return image[..., :3], image[..., 3]
