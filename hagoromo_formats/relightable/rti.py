"""Relightable images: PTM (LRGB), HSH (.rti), and the layout of Relight and OpenLIME (info.json, planes as JPEG).

A display value of a pixel is a sum of functions of the direction to a far lamp, (u, v) its first two components.
PTM: u², v², uv, u, v, 1, of luminance, times a colour. Malzbender et al. 2001, "Polynomial texture maps"; format 1.2.
HSH: nine hemispherical harmonics of each channel. Gautron et al. 2004, "A novel hemispherical basis for accurate and
efficient rendering". Relight's planes: Ponchio et al. 2019, "RELIGHT: a compact and accurate RTI
representation for the web". The layouts are those that the public sources of RTIViewer (hsh.cpp), Relight and OpenLIME
(ShaderRTI.js) read and write; none of these programs has opened a file of ours. They turn no lamp lower than 0.15 rad.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.record import write_json

Array = NDArray[Any]
QUALITY = 95  # of JPEG planes


def ptm_basis(directions: Array) -> Array:
    """(lamps, 6): u², v², uv, u, v, 1."""
    u, v = directions[:, 0], directions[:, 1]
    return np.stack([u * u, v * v, u * v, u, v, np.ones_like(u)], axis=1)


def hsh_basis(directions: Array) -> Array:
    """(lamps, 9) hemispherical harmonics up to degree 2, in the order of RTI viewers."""
    turn, c = np.arctan2(directions[:, 1], directions[:, 0]), directions[:, 2]
    root = np.sqrt(np.maximum(c - c * c, 0.0))
    columns = [
        np.full_like(c, 1.0 / np.sqrt(2.0 * np.pi)),
        np.sqrt(6.0 / np.pi) * np.cos(turn) * root,
        np.sqrt(1.5 / np.pi) * (2.0 * c - 1.0),
        np.sqrt(6.0 / np.pi) * np.sin(turn) * root,
        np.sqrt(30.0 / np.pi) * np.cos(2.0 * turn) * (c * c - c),
        np.sqrt(30.0 / np.pi) * np.cos(turn) * (2.0 * c - 1.0) * root,
        np.sqrt(2.5 / np.pi) * (1.0 - 6.0 * c + 6.0 * c * c),
        np.sqrt(30.0 / np.pi) * np.sin(turn) * (2.0 * c - 1.0) * root,
        np.sqrt(30.0 / np.pi) * np.sin(2.0 * turn) * (c * c - c),
    ]
    return np.stack(columns, axis=1)


def fitted(pictures: Sequence[Array], basis: Array) -> Array:
    """(terms, h, w, channels) least-squares coefficients of `pictures`, one per row of `basis`."""
    solve = np.linalg.pinv(basis)
    total = np.zeros((basis.shape[1], *pictures[0].shape))
    for picture, column in zip(pictures, solve.T, strict=True):
        total += column[:, None, None, None] * picture
    return total


def write_ptm(path: Path, pictures: Sequence[Array], directions: Array) -> None:
    """PTM_1.2, PTM_FORMAT_LRGB, of display `pictures` (h, w, 3) under lamps in `directions`; rows from the bottom."""
    colour = np.mean(pictures, axis=0)
    colour /= np.maximum(colour.max(axis=2, keepdims=True), 1e-6)
    grey = [
        (np.sum(picture * colour, axis=2) / np.sum(colour**2, axis=2).clip(1e-6))[..., None] for picture in pictures
    ]
    terms = 255.0 * fitted(grey, ptm_basis(directions))[..., 0]  # a viewer divides by 255
    scale, bias, codes = [], [], []
    for term in terms:
        low, high = float(term.min()), float(term.max())
        step = max((high - low) / 255.0, 1e-6)
        offset = round(-low / step)
        codes.append(np.clip(np.rint(term / step) + offset, 0, 255).astype(np.uint8))
        scale.append(f"{step:.9g}")
        bias.append(str(offset))
    height, width = terms.shape[1:]
    head = f"PTM_1.2\nPTM_FORMAT_LRGB\n{width}\n{height}\n{' '.join(scale)}\n{' '.join(bias)}\n"
    tints = np.rint(255.0 * colour).astype(np.uint8)
    path.write_bytes(head.encode("ascii") + np.stack(codes, axis=2)[::-1].tobytes() + tints[::-1].tobytes())


def write_hsh(path: Path, pictures: Sequence[Array], directions: Array) -> None:
    """#HSH1.2 of display `pictures`: per term scale and bias, value = byte / 255 · scale + bias; rows from the top."""
    terms = fitted(pictures, hsh_basis(directions))
    low = terms.min(axis=(1, 2, 3))
    scale = np.maximum(terms.max(axis=(1, 2, 3)) - low, 1e-6)
    codes = np.rint(255.0 * (terms - low[:, None, None, None]) / scale[:, None, None, None]).astype(np.uint8)
    height, width = terms.shape[1:3]
    head = f"#HSH1.2\n3\n{width} {height} 3\n{len(terms)} 2 1\n".encode("ascii")
    numbers = np.concatenate([scale, low]).astype("<f4").tobytes()
    path.write_bytes(head + numbers + np.ascontiguousarray(codes.transpose(1, 2, 3, 0)).tobytes())


def write_relight(folder: Path, pictures: Sequence[Array], directions: Array) -> None:
    """info.json and plane_K.jpg, K-th term of red, green and blue: type hsh, colour space rgb."""
    import cv2

    terms = fitted(pictures, hsh_basis(directions))
    low, high = terms.min(axis=(1, 2)), terms.max(axis=(1, 2))
    scale = np.maximum(high - low, 1e-6)
    folder.mkdir()
    for number, term in enumerate(terms):
        code = np.rint(255.0 * (term - low[number]) / scale[number]).astype(np.uint8)
        settings = [cv2.IMWRITE_JPEG_QUALITY, QUALITY, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111]
        done, data = cv2.imencode(".jpg", np.ascontiguousarray(code[..., ::-1]), settings)
        if not done:
            raise OSError(f"plane {number} could not be encoded as JPEG")
        (folder / f"plane_{number}.jpg").write_bytes(data.tobytes())
    height, width = terms.shape[1:3]
    material = {"scale": scale.ravel().tolist(), "bias": (-low / scale).ravel().tolist()}
    info = {"width": width, "height": height, "format": "jpg", "type": "hsh", "colorspace": "rgb",
            "nplanes": 3 * len(terms), "quality": QUALITY, "materials": [material]}  # fmt: skip
    write_json(folder / "info.json", info)


WRITERS: dict[str, tuple[str, Callable[[Path, Sequence[Array], Array], None]]] = {
    "ptm": ("object.ptm", write_ptm),
    "hsh": ("object.rti", write_hsh),
    "relight": ("relight", write_relight),
}
BASES = {"ptm": ptm_basis, "hsh": hsh_basis, "relight": hsh_basis}
