"""Scene palette: the reflectances of a scene, and the colours that the weights of its pictures are of."""

from __future__ import annotations

from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.settings import Settings
from hagoromo.light.spectrum import Spectrum
from hagoromo.light.wide_light import WideLight
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.film import tile_order as tile_order
from hagoromo.transport.palette import Palette, palette_of


def reflectances_of(scene: Scene) -> list[Reflectance]:
    """Those of all boxes, then of all surfaces, as materials are numbered."""
    return [m for box in scene.boxes for m in box.materials] + [s.reflectance for s in scene.surfaces]


def bases_of(scene: Scene) -> list[Spectrum]:
    """The spectra of which body colours of single voxels and places of surfaces are sums."""
    textures = [surface.body_texture for surface in scene.surfaces if surface.body_texture is not None]
    return [
        spectrum
        for thing in (*(box.basis for box in scene.boxes), *(t.spectra for t in textures))
        for spectrum in thing
    ]


def grouped_lights(scene: Scene, palette: Palette) -> list[tuple[WideLight, tuple[int, ...]]]:
    """The wide lights of a scene, each with the groups of its parts in a palette of the scene's lights."""
    first, pairs = len(scene.lamps), []
    for light in scene.wide_lights:
        last = first + len(light.parts)
        pairs.append((light, tuple(palette.lamp_groups[first:last])))
        first = last
    return pairs


def palette_of_scene(scene: Scene, settings: Settings) -> Palette:
    """The colours that the weights of a scene's picture are of, without bands of higher orders."""
    colours = palette_of(reflectances_of(scene), bases_of(scene), [])
    return colours.with_lamps(scene.lights, settings.separate_lamps)
