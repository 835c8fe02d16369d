"""Fit a measured table of reflectances

A table of BRDF values, as a goniometer or a database gives it, becomes a material with intervals. Here the table is
computed from another model, a GGX coat on a matte ground, so that the fit cannot be perfect.
"""

import matplotlib.pyplot as plt
import numpy as np

import hagoromo as hg

# %%
# ## The table
#
# Directions to the lamp and to the eye are in one plane, θ from the normal. Of a file, `hagoromo fit table.csv` (or
# MERL's `.binary`, RGL's `.bsdf`) does what this page does: [formats](../reference/formats.md). GGX is the facet
# distribution of [@walter2007], with Schlick's Fresnel and Smith's shadowing.

ROUGHNESS, F0, GROUND = 0.25, 0.04, np.array([0.35, 0.22, 0.12]) / np.pi


def ggx(lamp, eye):
    """BRDF [1/sr] of directions (N, 3), normal +z."""
    half = (lamp + eye) / np.linalg.norm(lamp + eye, axis=1, keepdims=True)
    tilt, squared = half[:, 2] ** 2, ROUGHNESS**4
    facets = squared / np.pi / (tilt * (squared - 1.0) + 1.0) ** 2
    fresnel = F0 + (1.0 - F0) * (1.0 - np.sum(lamp * half, axis=1)) ** 5

    def smith(cosine):
        return 2.0 / (1.0 + np.sqrt(1.0 + squared * (1.0 / cosine**2 - 1.0)))

    coat = facets * fresnel * smith(lamp[:, 2]) * smith(eye[:, 2]) / (4.0 * lamp[:, 2] * eye[:, 2])
    return GROUND + coat[:, None]


def directions(angle):
    """Unit directions (N, 3) in the plane of x and z, by their angle from +z [rad]."""
    return np.stack([np.sin(angle), 0.0 * angle, np.cos(angle)], axis=-1).reshape(-1, 3)


theta_lamp, theta_eye = np.meshgrid(np.radians([5, 20, 35, 50, 65]), np.radians(np.arange(-74, 75, 2)), indexing="ij")
to_lamp, to_eye = directions(theta_lamp), directions(theta_eye)
exact = ggx(to_lamp, to_eye)
noise = 0.01 * exact
values = exact + noise * np.random.default_rng(0).standard_normal(exact.shape)

# %%
# ## The fit
#
# Facets are Gaussian, or have tails (ν) where the table shows them.

material = hg.fit_table(to_lamp, to_eye, values, noise**2, name="coat", channels="RGB")
for name in ("alpha", "beta", "gamma", "n"):
    low, high = material.interval_95[name]
    known = "" if material.identifiable[name] else "   not identifiable"
    print(f"{name:6} {getattr(material, name):.4f}   95 % interval {low:.4f} … {high:.4f}{known}")
print(f"nu     {material.nu}")
print(*material.remarks, sep="\n")

# %%
# ## How well it holds
#
# [`Reflectance.evaluate`](../reference/api/reflectance.md#hagoromo.Reflectance) takes whole arrays of directions and
# has the cosine of incidence in it. Values of the green channel. Towards grazing angles the coat shines otherwise than
# any facets of ours: the fit is of another model, and `lack_of_fit` has said so above. [Measured materials](../merl.md)
# shows the same for 80 real ones.

green = hg.Spectrum.constant(material.body_colour[1])
law = {"nu": material.nu, "lobes": material.lobes, "epsilon": material.epsilon, "sigma": material.sigma}
paint = hg.Reflectance(material.alpha, material.beta, material.gamma, material.n, green, **law)
fitted = paint.evaluate([0, 0, 1], to_lamp, to_eye)[:, 0] / to_lamp[:, 2]
shape = theta_lamp.shape
figure, (left, right) = plt.subplots(1, 2, figsize=(10, 3.8), layout="constrained")
for lamp, eye, seen, curve in zip(
    theta_lamp[:, 0], np.degrees(theta_eye), values[:, 1].reshape(shape), fitted.reshape(shape), strict=True
):
    (line,) = left.plot(eye, curve, label=f"{np.degrees(lamp):.0f}°")
    left.plot(eye, seen, ".", color=line.get_color(), markersize=3)
    right.plot(eye, 100.0 * (curve / seen - 1.0), color=line.get_color())
left.set(xlabel="angle to the eye [°]", ylabel="BRDF [1/sr]", yscale="log", title="dots: table, lines: fit")
left.legend(title="angle to the lamp")
right.set(xlabel="angle to the eye [°]", ylabel="fit over table − 1 [%]", title="what the model does not follow")
right.axhspan(-2.0, 2.0, color="0.9", label="noise, ± 2 σ")
right.legend()
plt.show()
inside = (np.abs(theta_eye) < np.radians(60.0)).ravel()
off = (fitted / exact[:, 1] - 1.0)[inside]
print(f"the fit differs from the exact values by {100 * np.sqrt(np.mean(off**2)):.1f} % (rms) within 60° of the normal")
