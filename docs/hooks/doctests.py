"""Examples in docstrings (`>>>` up to an empty line) as blocks of code: the reference would set them as quotations."""

from __future__ import annotations

import re
from typing import Any

from griffe import Extension, Object

EXAMPLE = re.compile(r"(?:^|(?<=\n))>>> .*?(?=\n\s*\n|\Z)", re.DOTALL)


class Doctests(Extension):
    """Fences around the examples of every docstring."""

    def on_object(self, *, obj: Object, **_: Any) -> None:
        """Mark the examples in the docstring of `obj`."""
        if obj.docstring and ">>> " in obj.docstring.value:
            obj.docstring.value = EXAMPLE.sub(lambda found: f"\n```pycon\n{found[0]}\n```\n", obj.docstring.value)
