"""Fill a volume box with cloth by a function of position, and render it on a floor: image.exr and image.png."""

import sys
from pathlib import Path

import drjit as dr

import hagoromo as hg

folder = Path(sys.argv[1] if len(sys.argv) > 1 else "out/examples")
folder.mkdir(parents=True, exist_ok=True)

grey = hg.Reflectance(0.04, 1.5, 0.2, 1.5, body_colour=hg.Spectrum.constant(1.0), name="floor")
indigo = hg.Spectrum([380, 450, 550, 610, 700], [0.3, 0.4, 0.2, 0.1, 0.25])
cloth = hg.Reflectance(0.3, 0.4, 0.37, 1.54, body_colour=indigo, element="cylinder", name="cloth")

SIDE, VOXEL = 0.128, 0.001  # [m]


def cone_with_folds(point):
    """Density 0…1 and the direction of the threads at points of the box [m]."""
    x, y = point.x - SIDE / 2, point.y - SIDE / 2
    radius, angle = dr.sqrt(x * x + y * y + 1e-9), dr.atan2(y, x)
    surface = 0.055 * (1.0 - 0.75 * point.z / SIDE) * (1.0 + 0.1 * dr.cos(11.0 * angle))
    density = dr.fmin(dr.fmax(0.4 * (surface - radius) / VOXEL + 0.5, 0.0), 1.0)
    return density, type(point)(-y / radius, x / radius, 0.0 * x)


box = hg.VolumeBox.from_field(cone_with_folds, (128, 128, 128), VOXEL, tau=1.0 / VOXEL, materials=[cloth])
white = hg.Spectrum.named("D65")
scene = hg.Scene(
    camera=hg.Camera.preset("canon_eos_kiss_digital", binning=8).look_at((0.4, -0.5, 0.3), (0.06, 0.06, 0.05)),
    lamps=(hg.Lamp(position=(-0.4, -0.5, 0.7), spectrum=white), hg.Lamp(position=(0.8, 0.7, 0.5), spectrum=white)),
    boxes=(box,),
    surfaces=(hg.Surface.floor(0.0, 2.0, grey),),
)
image = hg.render(scene, hg.Settings(samples=2))
print(*image.save(folder / "image.exr", scene.camera.response, force=True))
