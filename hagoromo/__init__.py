"""Hagoromo: from calibrated photographs to measured reflectance, volume boxes and rendered images.

    photographs ─develop→ Photograph ─calibrate→ Camera, Lamps ─measure→ Reflectance ─build→ VolumeBox ─render→ Image

`__init__.pyi` lists the public names in this order; each is loaded when it is first used. Those of packages beside the
core (`hagoromo_recovery`, `hagoromo_campaigns`, `hagoromo_page`, `hagoromo_formats`, `hagoromo_matter`) are entry
points of the group `hagoromo.names`.
"""

import ast
from pathlib import Path
from typing import Any

import lazy_loader

_STUB = ast.parse(Path(__file__).with_suffix(".pyi").read_text(encoding="utf-8"))
_IMPORTS = [node for node in _STUB.body if isinstance(node, ast.ImportFrom)]
_own, _, _ = lazy_loader.attach(
    __name__, submod_attrs={node.module: [alias.name for alias in node.names] for node in _IMPORTS if node.level}
)
__all__ = sorted(alias.name for node in _IMPORTS for alias in node.names)
_BESIDE = {alias.name for node in _IMPORTS if not node.level for alias in node.names}


def __dir__() -> list[str]:
    return list(__all__)


def __getattr__(name: str) -> Any:
    if name not in _BESIDE:
        return _own(name)
    from importlib.metadata import entry_points

    points = entry_points(group="hagoromo.names", name=name)
    if not points:
        raise AttributeError(f"hagoromo.{name} is of a package that is not installed")
    value = globals()[name] = next(iter(points)).load()
    return value
