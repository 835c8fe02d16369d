"""What has changed between two dates

A painted relief is photographed twice, by two cameras under two domes. Between the dates a spot of its paint has faded
and a flake is lost. Which pixels have changed is found from what both measurements state of their errors.
"""

from dataclasses import replace

import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## A relief at two dates
#
# A plate of 3 cm with gentle hills and a pattern of paint. The spot loses 8 % of its paint's colour; the flake is 0.15
# mm deep.

GRID, HALF = 161, 0.015  # vertices a side, half width [m]
SPOT, FLAKE = (0.006, 0.004, 0.003), (-0.006, -0.004, 0.003)  # x, y, radius [m]
x, y = np.meshgrid(np.linspace(-HALF, HALF, GRID), np.linspace(-HALF, HALF, GRID))
random = np.random.default_rng(0)


def waves(count, finest):
    """A smooth random pattern of standard deviation 1."""
    found = np.zeros_like(x)
    for _ in range(count):
        a, b, phase = *random.normal(size=2) / finest, random.uniform(0.0, 2.0 * np.pi)
        found += np.sin(a * x + b * y + phase)
    return found / found.std()


def disc(place):
    """1 in the disc, 0 beside it, over an edge of 0.5 mm."""
    return 0.5 * (1.0 - np.tanh((np.hypot(x - place[0], y - place[1]) - place[2]) / 2.5e-4))


height = 4e-4 * waves(20, 0.003)
paint = np.stack([mean * np.exp(0.25 * waves(30, 0.0015)) for mean in (0.5, 0.4, 0.3)], axis=-1)
across = np.arange(GRID - 1)
corner = (across[:, None] * GRID + across).ravel()
faces = np.concatenate(
    [np.stack([corner, corner + 1, corner + GRID + 1], 1), np.stack([corner, corner + GRID + 1, corner + GRID], 1)]
)
lacquer = hg.Reflectance(0.2, 0.0, 0.25, 1.5, hg.Spectrum.constant(1.0), name="paint")


def relief(height, paint):
    """The plate as a mesh, its paint by vertex."""
    vertices = np.stack([x, y, height], axis=-1).reshape(-1, 3)
    colours = hg.SurfaceTexture(paint.reshape(-1, 3), of="vertices")
    return hg.Surface(lacquer, vertices=vertices, faces=faces, body_texture=colours, name="relief")


before = relief(height, paint)
after = relief(height - 1.5e-4 * disc(FLAKE), paint * (1.0 + 0.08 * disc(SPOT))[..., None])

# %%
# ## Photographs and measurements
#
# Twelve far lamps each; at the second date the camera stands elsewhere, and the dome has turned. Nothing but the
# photographs, the lamps and the cameras is known to `measure`.

sensor = hg.Camera.preset("canon_eos_kiss_digital").sensor
assert sensor is not None
sensor = replace(sensor, mosaic="")  # every pixel has all channels


def measured(surface, eye, turn, size, name):
    """A measurement of unknown shape."""
    focal = 0.42 * size * np.linalg.norm(eye) / HALF
    camera = hg.Camera(size, size, (focal, focal), (size / 2, size / 2), response=hg.Response.load("canon_eos_300d"))
    camera = replace(camera.look_at(eye, (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0)), sensor=sensor)
    photographs = []
    for number in range(12):
        tilt, around = np.radians((30.0, 55.0)[number % 2]), 2.0 * np.pi * number / 12 + turn
        to_lamp = (np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt))
        lamp = hg.Lamp(to_lamp=to_lamp, intensity=2.0, spectrum=hg.Spectrum.named("D65"))
        scene = hg.Scene(camera, (lamp,), surfaces=(surface,))
        (photograph,) = hg.simulate(scene, hg.Settings(samples=4, seed=number)).photographs
        _, _, seen = hg.visible_shape(scene)
        photographs.append(replace(photograph, mask=seen >= 0, name=f"{number}"))
    return hg.measure(hg.Capture(tuple(photographs), name), distance=float(np.linalg.norm(eye)))


first = measured(before, (0.0, 0.0, 0.4), 0.0, 72, "first date")
second = measured(after, (0.04, -0.02, 0.42), 0.3, 78, "second date")
print(first)
print(second)

# %%
# ## The change
#
# Both are laid on one another by paint and relief. A region is marked where the difference is significant, at a rate of
# false discoveries of 5 % for all quantities together: a small region whose interval holds 0 may be one of these. Areas
# come out rather too large, as neighbours help to decide.

change = hg.change(first, second)
print(change.sentence)
print(f"registered to {change.registration.error_px:.4f} px")
for one in change.regions:
    print(
        f"{one.quantity:8} region {one.number}: {one.area:5.1f} {one.area_unit}, mean {one.mean:7.2f} {one.unit},"
        f" 95 % interval {one.low:.2f} … {one.high:.2f}"
    )

# %%
# ## Beside the truth
#
# On the pixels of the first date. [Compare two dates](../howto/change.md) says what is tested, what is taken out of the
# maps, and how far it is checked; `hagoromo change before after` does it from two folders.

places = change.before.points
away = [np.hypot(places[..., 0] - one[0], places[..., 1] - one[1]) - one[2] for one in (SPOT, FLAKE)]
inside = [0.5 * (1.0 - np.tanh(distance / 2.5e-4)) for distance in away]
linear = np.pi * 0.2 * np.array([0.5, 0.4, 0.3])
spot = float(hg.delta_e_2000(linear, 1.08 * linear))
print(f"true are a spot of {1e6 * np.pi * SPOT[2] ** 2:.0f} mm² and ΔE00 {spot:.2f}, and a flake as large, of 150 µm")
truth = {"colour": spot * inside[0], "shape": -150.0 * inside[1]}
figure, rows = plt.subplots(2, 3, figsize=(9.5, 6), layout="constrained")
for row, (name, true) in zip(rows, truth.items(), strict=True):
    quantity = change[name]
    (value,) = quantity.value.values()
    shown = np.where(quantity.compared, value, np.nan)
    most = float(np.abs(true[quantity.compared]).max())
    least, colours = (0.0, "magma") if name == "colour" else (-most, "RdBu")
    style = {"cmap": colours, "vmin": least, "vmax": most}
    row[0].imshow(np.where(quantity.compared, true, np.nan), **style)
    image = row[1].imshow(shown, **style)
    row[2].imshow(np.where(quantity.significance.found, shown, np.nan), **style)
    row[0].set_title(f"{name}: truth")
    row[1].set_title("difference")
    row[2].set_title("significant, 5 % false")
    figure.colorbar(image, ax=row, label=f"{name} [{quantity.unit}]")
for axes in rows.ravel():
    axes.set_axis_off()
plt.show()
