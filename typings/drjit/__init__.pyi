# Dr.Jit's own stubs type the result of clip, select and others as `object`, so that no formula passes the type check.
from typing import Any

def __getattr__(name: str) -> Any: ...
