"""Film files: frames → MP4 (H.264), WebM (VP9) by PyAV, or GIF by Pillow."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError

Frame = NDArray[np.uint8]
CODECS = {".mp4": ("libx264", {"crf": "16", "preset": "medium"}), ".webm": ("libvpx-vp9", {"crf": "24", "b:v": "0"})}
SUFFIXES = (*CODECS, ".gif")
GIF_COLOURS = 256
FRAMES = "_frames"  # end of the name of the folder beside a film


def frames_of(film: Path) -> Path:
    """The folder beside a film that holds its frames."""
    return film.with_name(film.stem + FRAMES)


def check_film_name(path: str | Path) -> None:
    """`InputError` for a film of another format, or one that a missing package writes."""
    suffix = Path(path).suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a film is written as {', '.join(SUFFIXES)}, or as a folder of frames")
    if suffix in CODECS:
        _av()


def write_film(path: Path, suffix: str, frames: Iterable[Frame], rate: float) -> None:
    """Write frames (height, width, 3) uint8, all of one size, at `rate` a second; suffix: of SUFFIXES, the format."""
    if suffix == ".gif":
        _write_gif(path, list(frames), rate)
        return
    av: Any = _av()
    codec, options = CODECS[suffix]
    with av.open(str(path), "w", format=suffix[1:]) as container:
        stream: Any = None
        for frame in frames:
            even = np.pad(frame, ((0, frame.shape[0] % 2), (0, frame.shape[1] % 2), (0, 0)), mode="edge")
            if stream is None:
                stream = container.add_stream(codec, rate=Fraction(rate).limit_denominator(1000), options=options)
                stream.height, stream.width = even.shape[:2]
                stream.pix_fmt = "yuv420p"
            for packet in stream.encode(av.VideoFrame.from_ndarray(np.ascontiguousarray(even), format="rgb24")):
                container.mux(packet)
        for packet in stream.encode():
            container.mux(packet)


def _write_gif(path: Path, frames: Sequence[Frame], rate: float) -> None:
    """All frames share one palette, made from eight of them, so that still parts do not flicker."""
    from PIL import Image

    some = np.concatenate(frames[:: max(len(frames) // 8, 1)])
    palette = Image.fromarray(some).quantize(GIF_COLOURS)
    pictures = [Image.fromarray(frame).quantize(palette=palette) for frame in frames]
    pictures[0].save(path, "GIF", save_all=True, append_images=pictures[1:], duration=round(1000 / rate), loop=0)


def _av() -> Any:
    try:
        import av
    except ImportError:
        raise InputError("MP4 and WebM need PyAV, which is not installed: pip install 'hagoromo[film]'") from None
    return av
