"""Hagoromo: from calibrated photographs to measured reflectance, volume boxes and rendered images.

    photographs ─develop→ Photograph ─calibrate→ Camera, Lamps ─measure→ Reflectance ─build→ VolumeBox ─render→ Image

`__init__.pyi` lists the public names in this order; each is loaded when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
