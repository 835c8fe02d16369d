"""Preview: pictures of a scene that is being edited, each better than the last.

The first picture has fewer pixels and coarser shadow maps, to arrive in time. Each next one halves the stride; the last
ones have all pixels and add samples, until the picture equals that of `render` bit by bit. To interrupt is to take no
more pictures. What did not change since the last scene stays on the device.
"""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.image.march_picture import picture
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.lamp_batches import lamp_batches
from hagoromo.image.prepared.lit_by_points import lit_by_points
from hagoromo.image.prepared.prepared_scene import PreparedScene, SceneCache, shadow_casters
from hagoromo.image.prepared.seen_lights import SeenLights, camera_sees_lights, with_light
from hagoromo.image.scene.given_scene import scene_and_settings
from hagoromo.image.scene.origin import scene_from, scene_origin
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings, metadata
from hagoromo.transport.film import Film, pixel_points

FIRST_SECONDS = 0.1  # time until the first picture [s]
FIRST_RAYS = 1 << 15  # rays of a first picture before any has been timed
FEWEST_RAYS = 1 << 8  # rays of a first picture at least
TIME_SHARE = 0.8  # share of the allowed time that is planned: the next picture may be slower
RAY_GROWTH = 4  # largest factor on the rays from one first picture to the next: a halving of the stride


def preview(
    scene: Scene | str | Path, settings: Settings | None = None, seconds: float = FIRST_SECONDS
) -> Iterator[Image]:
    """Pictures of `scene`, each better than the last; the last one is what `render` gives.

    scene: a `Scene`, or the path of a scene TOML. seconds: until the first picture, about. See `Preview`, which keeps
    what the next scene can use.

    >>> matte = hg.Reflectance.matte(0.25, hg.Spectrum.constant(1.0))
    >>> camera = hg.Camera(9, 7, (20, 20), (4.5, 3.5)).look_at(eye=(0, -1, 0), target=(0, 0, 0))
    >>> ball = hg.Surface.sphere(centre=(0, 0, 0), radius=0.1, reflectance=matte)
    >>> scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0)),), surfaces=(ball,))
    >>> *_, last = hg.preview(scene)
    >>> np.array_equal(last.weights, hg.render(scene).weights)
    True
    """
    scene, settings = scene_and_settings(scene, settings)
    return Preview(settings, seconds).pictures(scene)


class Preview:
    """The state of a viewer: `settings` of the last picture, `seconds` until the first, and a cache on the device.

        view = hg.Preview()
        while scene := changed():                       # a Scene with another camera, lamps, materials, poses, …
            for image in view.pictures(scene):
                show(image.display())                   # of its own size: the window scales it
                if waiting():
                    break

    The first picture has as many rays as were traced in time before. An image's metadata["preview"] says its stride
    (camera pixels along a side of one of its own), its samples and the share of the work done, 0…1. Under more than
    LAMPS_AT_ONCE lamps all samples come with one picture.
    """

    def __init__(self, settings: Settings | None = None, seconds: float = FIRST_SECONDS) -> None:
        if not seconds > 0:
            raise InputError(f"the first picture is to come after {seconds} s: give a number above 0")
        self.settings, self.seconds, self.cache = settings or Settings(), seconds, SceneCache()
        self.rays = {False: FIRST_RAYS, True: FIRST_RAYS}  # of a first picture; True: new shadow maps are needed
        self.least = {False: math.inf, True: math.inf}  # s, that a first picture took

    def pictures(self, scene: Scene) -> Iterator[Image]:
        """Pictures of `scene`; the last one is what `render` gives."""
        start, size = time.perf_counter(), scene.camera.width * scene.camera.height
        whole, (scene, points_of_light) = scene, lit_by_points(scene, self.settings)
        record = metadata(whole, self.settings) | points_of_light
        new_shadows = self.cache.key("maps")[:1] != (
            shadow_casters(scene_from(scene, scene_origin(scene)), self.settings),
        )
        coarse = strides(size, self.rays[new_shadows])
        points = pixel_points(self.settings.samples, self.settings.seed)
        if len(lamp_batches(scene.lamps)) > 1:
            for image in self._in_batches(whole, coarse):
                yield replace(image, metadata=image.metadata | record)
            return
        lights: SeenLights | None = None
        steps = [(stride, pixel_points(1, 0)[0]) for stride in coarse] + [(1, point) for point in points]
        work = [stride**-2 for stride, _ in steps]
        for number, (stride, point) in enumerate(steps):
            if number <= len(coarse):  # each coarse picture and the first whole one start anew
                prepared = PreparedScene(scene, self.settings, self.cache, stride)
                film = Film(prepared.camera, prepared.channels, stride, prepared.ahead)
                lights = SeenLights(whole, self.settings, self.cache, stride) if camera_sees_lights(whole) else None
            film.add(prepared.camera_radiance, point)
            level = {"stride": stride, "samples": film.samples, "share": sum(work[: number + 1]) / sum(work)}
            image = Image(*film.mean(), prepared.palette, record | {"preview": level})
            if lights is not None:
                lights.film.add(lights.radiance, point)
                image = with_light(image, lights.film.mean()[0])
            if number == 0:
                self._learn(new_shadows, math.ceil(size / stride**2), time.perf_counter() - start)
            yield image

    def _in_batches(self, scene: Scene, coarse: list[int]) -> Iterator[Image]:
        """Pictures of a scene of many lamps: the coarse ones, and that of `render`, each by all batches of lamps."""
        samples = self.settings.samples
        steps = [(stride, pixel_points(1, 0)) for stride in coarse] + [(1, pixel_points(samples, self.settings.seed))]
        work = [len(points) * stride**-2 for stride, points in steps]
        for number, (stride, points) in enumerate(steps):
            image = picture(scene, self.settings, self.cache, points, stride)
            level = {"stride": stride, "samples": len(points), "share": sum(work[: number + 1]) / sum(work)}
            yield replace(image, metadata=image.metadata | {"preview": level})

    def _learn(self, new_shadows: bool, rays: int, seconds: float) -> None:
        """A first picture of `rays` took `seconds`: so many next time as would be there within TIME_SHARE of the time.

        The shortest time so far stands for what a picture costs however few its rays.
        """
        least = self.least[new_shadows] = min(self.least[new_shadows], seconds)
        spare, spent = TIME_SHARE * self.seconds - least, max(seconds - least, 1e-9)
        growth = min(max(spare / spent, 1 / RAY_GROWTH), RAY_GROWTH)
        self.rays[new_shadows] = max(int(rays * growth), FEWEST_RAYS)


def strides(size: int, rays: int) -> list[int]:
    """Strides that halve, down to 3 or 2; the first, 2^k or 3 · 2^k, leaves at most `rays` of `size` pixels.

    Empty if all pixels are as few.
    """
    stride, found = 1, []
    while size > rays * stride**2:
        stride += max(stride // 2, 1) if stride & (stride - 1) == 0 else stride // 3  # 1, 2, 3, 4, 6, 8, 12, …
    while stride > 1:
        found.append(stride)
        stride //= 2
    return found
