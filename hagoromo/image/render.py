"""Render: scene → Image, by one of the modes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from hagoromo.errors import InputError
from hagoromo.files.cache import cache
from hagoromo.files.record import read_toml
from hagoromo.image.march_picture import picture
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.scene.modes import Mode
from hagoromo.image.scene.scene import Scene, check_still
from hagoromo.image.scene.settings import Settings, check_mode
from hagoromo.progress import LOADING, Progress, part_of, silent
from hagoromo.transport.film import pixel_points
from hagoromo.transport.film import tile_order as tile_order

if TYPE_CHECKING:
    from hagoromo.image.scene.motion import Motion


def render(
    scene: Scene | str | Path,
    settings: Settings | None = None,
    progress: Progress = silent,
    scheduler: str | int | None = None,
    mode: Mode = "march",
    unfinished: Image | None = None,
    layers: bool = False,
    times: int | None = None,
) -> Image:
    """The image that the scene's camera would see, as weights.

    scene: a `Scene`, or the path of a scene TOML, which is then rendered as it states unless `settings` are given.
    In mode full the light of a scene file is kept for the next picture of it, see `hagoromo cache`.
    scheduler: a number of processes, "local", or the address of a Dask scheduler ("tls://host:8786", or a
    `TrustedScheduler`), whose workers render the tiles of a scene file; the bits are the same. `InputError` for a file
    that describes no scene, and a scheduler that does not answer or that nobody vouches for.
    mode: of MODES. "march": light that is scattered once, without noise. "full": light of all orders, solved once on a
    coarse grid and mended by random walks, with `Image.full_error`. "path": light of all orders, estimated without bias
    by `settings.samples` random walks through each pixel; it has noise, see `Image.variance`. An interrupt of it raises
    `RenderInterrupted`, a `KeyboardInterrupt`, with the picture so far.
    unfinished: such a picture, to go on from to the bits of an uninterrupted run; mode path only.
    layers: whether the image has depth, normals, albedo and materials, too, see `Image.layers`.
    times: of a scene file with a shutter, the mean of so many pictures while it is open, in any mode; None: mode path
    follows what moves, walk by walk, and other modes refuse it.

    A matte ball under a far lamp behind the camera: its middle reflects E α = 2 · 0.25 of the lamp's spectrum.

    >>> matte = hg.Reflectance.matte(0.25, hg.Spectrum.constant(1.0))
    >>> camera = hg.Camera(9, 7, (20, 20), (4.5, 3.5)).look_at(eye=(0, -1, 0), target=(0, 0, 0))
    >>> ball = hg.Surface.sphere(centre=(0, 0, 0), radius=0.1, reflectance=matte)
    >>> image = hg.render(hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0), intensity=2.0),), surfaces=(ball,)))
    >>> image.weights.shape, round(float(image.weights[3, 4].sum()), 4)
    ((7, 9, 2), 0.5)
    """
    check_mode(settings or Settings(), mode)
    kept = cache() if mode == "full" and not isinstance(scene, Scene) else None
    if unfinished is not None and mode != "path":
        raise InputError(f"mode is {mode!r}: only pictures of mode path are resumed")
    motion = None if isinstance(scene, Scene) else motion_with_shutter(scene)
    if times is not None or motion is not None:
        _check_shutter(scene, mode, scheduler, unfinished, layers, times)
    if scheduler is not None:
        from hagoromo.image.render_tiles import render_on  # Dask is an extra

        return render_on(scheduler, scene, settings, progress, mode, unfinished, layers)
    if times is not None and not isinstance(scene, Scene):
        from hagoromo.image.film.shutter import mean_over_times

        return mean_over_times(scene, settings, times, mode, progress)
    if motion is not None and not isinstance(scene, Scene):
        from hagoromo.image.film.shutter import scene_with_shutter

        scene, stated = scene_with_shutter(scene, motion, progress)
        settings = settings or stated
    if not isinstance(scene, Scene):
        # only a file needs the readers of boxes and cameras; light of higher orders comes from all of a box
        from hagoromo.image.scene.scene_file import load_for_picture, load_scene

        loading, progress = part_of(progress, 0.0, LOADING), part_of(progress, LOADING, 1.0 - LOADING)
        loaded, stated = load_for_picture(scene, settings, loading) if mode == "march" else load_scene(scene, loading)
        scene, settings = loaded, settings or stated
    settings = settings or Settings()
    image = picture_of_mode(mode, scene, settings, SceneCache(kept), progress, unfinished)
    if not layers:
        return image
    from hagoromo.image.layers import with_layers

    return with_layers(image, scene, settings)


def motion_with_shutter(path: str | Path) -> Motion | None:
    """The motion of a scene file whose shutter is open for some time; None of another one."""
    if "shutter_close" not in read_toml(path).get("motion", {}):
        return None
    from hagoromo.image.scene.motion import read_motion

    motion = read_motion(path)
    return motion if motion.shutter else None


def _check_shutter(
    scene: Scene | str | Path,
    mode: Mode,
    scheduler: str | int | None,
    unfinished: Image | None,
    layers: bool,
    times: int | None,
) -> None:
    """`InputError` for what a picture of a scene that moves cannot have."""
    if isinstance(scene, Scene):
        raise InputError("times are those of a scene file with a shutter: give its path")
    if mode != "path" and times is None:
        raise InputError(
            f"{scene} has a shutter, and mode {mode} shows single instants: render by mode path, or the mean of "
            f"pictures at several times (--times 16)"
        )
    if layers:
        raise InputError(f"{scene} has a shutter: pictures of what moves have no layers: leave that out")
    if times is not None and (scheduler is not None or unfinished is not None):
        what = "workers" if scheduler is not None else "unfinished picture"
        raise InputError(f"{scene}: the mean of pictures at several times has no {what}: leave that out")


def picture_of_mode(
    mode: Mode,
    scene: Scene,
    settings: Settings,
    cache: SceneCache,
    progress: Progress = silent,
    unfinished: Image | None = None,
) -> Image:
    """What `render` gives, without layers; what did not change since the last scene of `cache` is used again."""
    if mode == "path":
        from hagoromo.image.path.picture import path_picture  # the march does without

        return path_picture(scene, settings, progress, unfinished, cache)
    check_still(scene, f"mode {mode}")
    points = pixel_points(settings.samples, settings.seed)
    if mode == "full":
        from hagoromo.image.full.picture import full_picture

        return full_picture(scene, settings, points, cache, progress)
    return picture(scene, settings, cache, points, progress=progress)
