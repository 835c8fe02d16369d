"""The gradient of light, and a small recovery

A box of fog is changed until it sends the light of another one: the derivative of a loss by the density of every voxel,
in one pass (reverse mode), and twenty-five steps along it.
"""

import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## The truth, and what is seen of it
#
# A cloud of grains under two lamps is seen along two thousand rays from all around. Shadows within it are part of what
# is differentiated.

SIDE, VOXEL = 16, 0.0075  # voxels, [m]
z, y, x = (np.mgrid[:SIDE, :SIDE, :SIDE] - (SIDE - 1) / 2) * VOXEL
truth = np.exp(-((x - 0.015) ** 2 + y**2 + 2.0 * z**2) / 0.02**2)
truth += np.exp(-((x + 0.025) ** 2 + (y - 0.01) ** 2 + z**2) / 0.015**2)
grains = hg.Reflectance(0.25, 0.2, 0.3, 1.5, hg.Spectrum.constant(1.0), element="sphere", name="grains")
lamps = hg.Lamp(position=(0.5, -0.5, 0.5), intensity=0.5), hg.Lamp(position=(-0.5, 0.4, 0.6), intensity=0.5)
middle = (SIDE * VOXEL / 2,) * 3
camera = hg.Camera(64, 64, (220.0, 220.0), (32.0, 32.0)).look_at((0.06, -0.45, 0.2), middle)


def box_of(density):
    """A box of these densities (16, 16, 16)."""
    return hg.VolumeBox.from_arrays(density, np.zeros((*density.shape, 3)), VOXEL, 60.0, [grains], name="cloud")


def marched(density):
    """Light along rays through such a box, and its derivatives."""
    return hg.RayMarch(hg.Scene(camera, lamps, (box_of(density),)), differentiable=True)


random = np.random.default_rng(0)
eyes = random.normal(size=(2000, 3))
eyes = middle + 0.5 * eyes / np.linalg.norm(eyes, axis=1, keepdims=True)
rays = eyes, random.uniform(0.0, SIDE * VOXEL, eyes.shape) - eyes
seen = marched(truth)(*rays)

# %%
# ## Is the gradient right?
#
# The loss is ½ Σ (light − seen)² of weights and transmittance. Its derivative by one voxel is held against a central
# difference.


def loss(light):
    """How far the light of a box is from what is seen."""
    return 0.5 * (np.sum((light.weights - seen.weights) ** 2) + np.sum((light.transmittance - seen.transmittance) ** 2))


def by_light(light):
    """The derivative of the loss by that light."""
    return hg.RayLight(light.weights - seen.weights, light.transmittance - seen.transmittance)


def by_density(march):
    """The derivative of the loss by every voxel, (16, 16, 16)."""
    slopes = march.gradient(*rays, by_light).density
    assert slopes is not None
    return slopes[0]


found = marched(np.full(truth.shape, 0.1))
slope = by_density(found)
for voxel in ((7, 8, 9), (10, 5, 6)):
    sides = []
    for change in (0.01, -0.01):
        density = np.full(truth.shape, 0.1)
        density[voxel] += change
        found.density = [density]
        sides.append(loss(found(*rays)))
    print(f"voxel {voxel}: gradient {slope[voxel]:.6f}, central difference {(sides[0] - sides[1]) / 0.02:.6f}")

# %%
# ## Twenty-five steps
#
# By Adam. [Derivatives of light](../howto/derivatives.md) does the same in Dr.Jit and PyTorch, and says what a gradient
# leaves out; [`hagoromo recover`](../howto/recover.md) recovers boxes from photographs.

found.density = [np.full(truth.shape, 0.1)]
mean, square, errors, losses = 0.0, 0.0, [], []
for step in range(1, 26):
    slope = by_density(found)
    mean, square = 0.8 * mean + 0.2 * slope, 0.95 * square + 0.05 * slope**2
    move = 0.1 * mean / (1 - 0.8**step) / np.sqrt(square / (1 - 0.95**step) + 1e-12)
    found.density = [np.maximum(found.density[0] - move, 0.0)]
    losses.append(loss(found(*rays)))
    errors.append(np.sqrt(np.mean((found.density[0] - truth) ** 2)))
print(f"the density is off by {errors[-1]:.3f} (rms) where it was off by {errors[0]:.3f} after the first step")

figure, (left, right) = plt.subplots(1, 2, figsize=(9, 3), layout="constrained")
left.semilogy(range(1, 26), losses)
left.set(xlabel="step", ylabel="loss", title="what is minimised")
right.plot(range(1, 26), errors)
right.set(xlabel="step", ylabel="error of the density, rms", title="what is not", ylim=(0, None))
plt.show()

# %%
# ## A slice, and a picture from a place where no ray began

figure, row = plt.subplots(2, 3, figsize=(9, 5.6), layout="constrained")
for axes, (name, density) in zip(
    row.T, {"truth": truth, "recovered": found.density[0], "start": np.full(truth.shape, 0.1)}.items(), strict=True
):
    shown = axes[0].imshow(density[SIDE // 2], vmin=0, vmax=1.0, origin="lower", extent=(0, SIDE * VOXEL * 100) * 2)
    axes[0].set(title=name, xlabel="x [cm]", ylabel="y [cm]")
    picture = hg.render(hg.Scene(camera, lamps, (box_of(density),)), hg.Settings(samples=4))
    axes[1].imshow(picture.display(exposure=4.0))
    axes[1].set_axis_off()
figure.colorbar(shown, ax=row[0], label="density")
plt.show()
