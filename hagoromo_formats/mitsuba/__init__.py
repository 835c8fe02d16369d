"""Mitsuba both ways: our reflectance as its BSDF `hagoromo`, volume boxes as its media, scenes in and out.

`import hagoromo_formats.mitsuba` loads nothing of Mitsuba; the names below are loaded when they are first used.
`register` works in the variant that Mitsuba has then: llvm or cuda with `_ad_rgb`, `_ad_spectral` or `_ad_mono`.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
