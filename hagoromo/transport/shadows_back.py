"""Shadows back: transmittance from lamps within a replay, and its derivative, by marching each shadow ray once more.

The optical depth to a lamp is a sum over the steps of the shadow ray: its derivative is that of one step at a time.
"""

from __future__ import annotations

from collections.abc import Callable

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays
from hagoromo.transport.crossing import MarchInterval
from hagoromo.transport.differentiable_medium import DifferentiableMedium, crossing_of
from hagoromo.transport.lighting import ShadowRay
from hagoromo.transport.march import OPAQUE_OPTICAL_DEPTH, optical_depth
from hagoromo.transport.moving import on_ray

LEAST_SHARE = 1e-5  # of the light of a lamp that a sample would send to the eye: less has no derivative by its shadow


class ShadowsBack:
    """`AttenuationOfAll` of a medium, whose derivative marches.

    by_voxels: whether voxels are tracked that attenuate light. by_rays: whether the rays to lamps move. seen: the share
    of a sample's light that reaches the eye, 0 where there is no matter to send any; see LEAST_SHARE. A plain object:
    loops do not take its arrays into their state.
    """

    def __init__(self, medium: DifferentiableMedium, by_voxels: bool, by_rays: bool) -> None:
        self.medium, self.search, self.by_voxels, self.by_rays = medium, medium.searching(), by_voxels, by_rays
        self.seen: Float = 1.0
        self.kept: list[tuple[ShadowRay, Float]] | None = None

    def __call__(self, rays: list[ShadowRay]) -> list[Float]:
        """Transmittance along each ray."""
        if not (self.by_voxels or self.by_rays):
            return self.transmittances(rays)
        if self.kept is not None:
            passed = self.transmittances(rays)
            dr.enable_grad(passed)
            self.kept += zip(rays, passed, strict=True)
            return passed
        tracked = arrays().Float(0)
        dr.enable_grad(tracked)  # without an input that is tracked, Dr.Jit would not ask for the derivative
        return list(dr.custom(_Transmittances, self, rays, tracked))

    def differentiate(self, light: Callable[[], Float]) -> None:
        """Differentiate light that is shaded, outside of loops: there Dr.Jit 1.5 cannot march within a derivative. The
        rays to lamps are kept, and marched behind it.
        """
        self.kept = kept = []
        total, self.kept = light(), None
        if not dr.grad_enabled(total):
            return
        dr.backward_from(total, flags=dr.ADFlag.ClearInterior)
        for (origin, to_lamp, distance), passed in kept:
            by_depth = dr.detach(passed) * -dr.grad(passed)
            fixed = dr.detach(origin), dr.detach(to_lamp), dr.detach(distance)
            dr.eval(fixed, by_depth)
            with dr.suspend_grad():
                by_origin, by_direction = _depth_back(_ShadowRay(self, fixed, by_depth))
                dr.eval(by_origin, by_direction)
            moved = dr.dot(origin, by_origin) + dr.dot(to_lamp, by_direction)
            if dr.grad_enabled(moved):
                dr.backward_from(moved, flags=dr.ADFlag.ClearInterior)

    def transmittances(self, rays: list[ShadowRay]) -> list[Float]:
        """The same without derivatives."""
        with dr.suspend_grad():
            zero = arrays().Float(0)
            return [dr.exp(-optical_depth(self.search, *dr.detach(ray[:2]), zero, dr.detach(ray[2]))) for ray in rays]


class _Transmittances(dr.CustomOp):
    """Transmittances with their derivative."""

    def eval(self, shadows: ShadowsBack, rays: list[ShadowRay], tracked: Float) -> tuple[Float, ...]:
        """Those of `ShadowsBack`."""
        self.shadows, self.rays = shadows, dr.detach(rays)
        self.passed = shadows.transmittances(rays)
        return tuple(self.passed)

    def backward(self) -> None:
        """March each ray, and differentiate its steps."""
        by_all = self.grad_out()  # 0 where gradients are suspended
        by_rays = []
        with dr.suspend_grad():
            for ray, passed, by_passed in zip(self.rays, self.passed, by_all, strict=True):
                enough = self.shadows.seen * passed > LEAST_SHARE
                by_depth = dr.select(enough, -passed * by_passed, 0.0)
                by_origin, by_direction = _depth_back(_ShadowRay(self.shadows, ray, by_depth))
                by_rays.append((by_origin, by_direction, dr.zeros(arrays().Float, dr.width(ray[2]))))
        if self.shadows.by_rays:
            self.set_grad_in("rays", by_rays)


class _ShadowRay:
    """A ray whose optical depth is differentiated, and the derivative of the loss by that. A plain object: what stays
    the same in a loop must not be in its state, as Dr.Jit would trace the loop once more, and lose derivatives of it.
    """

    def __init__(self, shadows: ShadowsBack, ray: ShadowRay, by_depth: Float) -> None:
        self.ray, self.by_depth, self.by_ray, self.medium = ray, by_depth, shadows.by_rays, shadows.medium
        self.search = shadows.search
        self.crossing = crossing_of(self.search, ray)

    def step_back(self, step: MarchInterval) -> tuple[Float, Array3f, Array3f]:
        """The optical depth of one step, differentiated; the derivative by origin and direction of the ray."""
        origin, direction, distance = self.ray
        still = dr.zeros(arrays().Array3f)
        with dr.resume_grad():
            if self.by_ray:
                origin, direction = dr.detach(origin), dr.detach(direction)
                dr.enable_grad(origin, direction)
                step = on_ray(crossing_of(self.medium, (origin, direction, distance)).ray(step.ray.box), step)
            depth = self.medium.extinction(step, direction).depth
            dr.backward_from(depth * self.by_depth)
            by_ray = (dr.grad(origin), dr.grad(direction)) if self.by_ray else (still, still)
        return dr.detach(depth), *by_ray


@dr.syntax
def _depth_back(way: _ShadowRay) -> tuple[Array3f, Array3f]:
    """Add the derivative of by_depth · (optical depth of a way) to the gradients of what is tracked; that by the origin
    and the direction of the ray.
    """
    state, count = way.crossing.start(), dr.width(way.ray)
    depth = dr.zeros(arrays().Float, count)
    by_origin, by_direction = dr.zeros(arrays().Array3f, count), dr.zeros(arrays().Array3f, count)
    while way.crossing.unfinished(state) & (depth < OPAQUE_OPTICAL_DEPTH) & (way.by_depth != 0.0):
        step = way.search.next(way.crossing, state)
        if step.brick >= 0:
            added, more, turned = way.step_back(step)
            depth, by_origin, by_direction = depth + added, by_origin + more, by_direction + turned
        state = way.crossing.enter_next_box(way.crossing.advance(step, state))
    return by_origin, by_direction
