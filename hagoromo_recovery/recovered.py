"""Recovered: what `recover` found, its pictures, and the box and mesh that are made of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f
from hagoromo.files.record import written_by
from hagoromo.files.whole import whole_file
from hagoromo.light.colour import srgb_encode
from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.choices import Law, Orders
from hagoromo_recovery.descent.look import Look
from hagoromo_recovery.descent.rendering import Rendering
from hagoromo_recovery.errors import Errors
from hagoromo_recovery.evidence import Evidence
from hagoromo_recovery.explained import Explained, explained
from hagoromo_recovery.field.distance_field import DistanceField
from hagoromo_recovery.field.matter_field import MatterField
from hagoromo_recovery.field.near_surface import NearSurface
from hagoromo_recovery.fuzzy_shape import FuzzyShape
from hagoromo_recovery.hollows import FoundHollow
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.outline.mask_offset import MaskOffset
from hagoromo_recovery.outline.object_view import ObjectView
from hagoromo_recovery.remarks import remarks_on
from hagoromo_recovery.shading.lamp_table import LampTable
from hagoromo_recovery.shading.mixed_gloss import MixedGloss, mixed_gloss
from hagoromo_recovery.shading.shading import NodeShading, figures

if TYPE_CHECKING:
    from hagoromo.volume.box import VolumeBox


LIGHTS = {
    "even": "unknown: body colours are the light that the surface sends out",
    "object": "unknown, fixed to the object: body colours are the light that is sent out over that of the mean normal",
    "camera": "unknown, fixed to the camera: body colours are the light that is sent out over that of the mean normal",
}


BRIGHTEST = 0.98  # of a body colour, which a reflectance must give back less than all of
BRIGHT = 99  # percentile of body colours that should be no more than 1: a few may be, by noise


class Score(NamedTuple):
    """How well a photograph is predicted. psnr: peak signal to noise [dB], over all valid pixels; inside: over those of
    the silhouette; the peak is the brightest value. Outside a stated silhouette the photograph counts as black,
    whatever its background is. scaled: psnr after one factor on the prediction.
    """

    name: str
    psnr: float
    inside: float
    scaled: float


class RecoveredMesh(NamedTuple):
    """vertices (n, 3) [m], faces (m, 3), unit normals (n, 3) outwards, body colours (n, 3) times `Recovered.dim`.

    photographs: (n,) that show each vertex; where none does, the surface is closed smoothly. Standard errors, NaN where
    they are not known: position_errors (n,) along the normal [m], normal_errors (n,) [rad]. gloss: β and γ (n,); None:
    the object has one gloss. gloss_errors: (n, 2) of ln β and ln γ.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int64]
    normals: NDArray[np.float64]
    colours: NDArray[np.float64]
    photographs: NDArray[np.int32]
    position_errors: NDArray[np.float32]
    normal_errors: NDArray[np.float32]
    gloss: MixedGloss | None = None
    gloss_errors: NDArray[np.float32] | None = None

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the mesh as PLY: its vertices have normals, sRGB colours, `photographs`, `position_error` [m] and
        `normal_error` [rad]; where the gloss differs from place to place, `beta` [1/sr], `gamma` [rad] and their
        standard errors, `beta_error` and `gamma_error`. `InputError` where `path` exists.
        """
        import trimesh

        colours = srgb_encode(np.clip(self.colours, 0.0, 1.0))
        parts = {"vertex_normals": self.normals, "vertex_colors": colours, "process": False}
        made = trimesh.Trimesh(self.vertices, self.faces, **parts)
        made.vertex_attributes["photographs"] = self.photographs
        made.vertex_attributes["position_error"] = self.position_errors
        made.vertex_attributes["normal_error"] = self.normal_errors
        if self.gloss is not None and self.gloss_errors is not None:
            for name, values, errors in zip(("beta", "gamma"), self.gloss, self.gloss_errors.T, strict=True):
                made.vertex_attributes[name] = values.astype(np.float32)
                made.vertex_attributes[f"{name}_error"] = (values * errors).astype(np.float32)
        with whole_file(path, force) as partial:
            made.export(partial, file_type="ply")
        return Path(path)


@dataclass(frozen=True, eq=False, repr=False)
class Recovered:
    """An object as photographs show it.

    lattice: where nodes are. distance: (nz, ny, nx) signed distance [voxel], negative inside. colours: (nz, ny, nx, 3)
    body colours, as the camera reads them relative to a white plane under the lamp: albedos. gloss: ln β, ln γ,
    ln(n − 1). softness: s [voxel]. photographs: those that it was recovered from; kept: those kept aside. lit: whether
    their lamps are known; if not, colours are the light that the surface sends out. stated: whether masks stated
    silhouettes. evidence: how well the gloss is known, and which places photographs show; None where the recovery was
    interrupted. errors: those of places; None where they were not asked for, or photographs too few for halves of
    three. complete: whether the recovery came to its end; it was interrupted otherwise. look: what was estimated
    beside the object; `photographs` and `kept` have the cameras and lamps that were found. fuzzy: the density of matter
    that has no surface, on the same lattice; `distance` is then that to the surface that stands for it, where the
    clearest way out has the optical depth ½. None: the matter is a surface. matter_tried: PSNR [dB] of each law that
    was tried. shares: (nz, ny, nx) of the second of two glosses, 0 … 1; None: the object has one gloss.
    gloss_tried: PSNR [dB] of one gloss and of one of each place, where both were tried. orders: of light that it was
    recovered by, and that `picture` shows; orders_tried: PSNR [dB] of both, where they were tried. masks: how far they
    are off; None: they are not, or photographs do not show it. dark: names of photographs without light, which took no
    part. hollow: the one that photographs asked for; None: none.
    """

    lattice: Lattice
    distance: NDArray[np.float32]
    colours: NDArray[np.float32]
    gloss: NDArray[np.float64]
    softness: float
    photographs: tuple[Photograph, ...]
    kept: tuple[ObjectView, ...]
    lit: bool
    settings: Mapping[str, Any] = field(default_factory=dict)
    name: str = ""
    assumptions: Mapping[str, str] = field(default_factory=dict)
    stated: bool = True
    evidence: Evidence | None = None
    errors: Errors | None = None
    complete: bool = True
    look: Look = field(default_factory=Look)
    fuzzy: FuzzyShape | None = None
    matter_tried: Mapping[str, float] = field(default_factory=dict)
    shares: NDArray[np.float32] | None = None
    gloss_tried: Mapping[str, float] = field(default_factory=dict)
    orders: Orders = "first"
    orders_tried: Mapping[str, float] = field(default_factory=dict)
    masks: MaskOffset | None = None
    dark: tuple[str, ...] = ()
    hollow: FoundHollow | None = None

    def __repr__(self) -> str:
        nodes = " × ".join(str(n) for n in self.lattice.shape[::-1])
        return f"Recovered({self.name!r}, {nodes} nodes of {1e3 * self.lattice.voxel:.3g} mm)"

    @property
    def beta(self) -> float:
        """Weight of the interface [1/sr]."""
        return figures(self.gloss)[0]

    @property
    def gamma(self) -> float:
        """Half width of the facets [rad]."""
        return figures(self.gloss)[1]

    @property
    def n(self) -> float:
        """Refractive index."""
        return figures(self.gloss)[2]

    def gloss_at(self, place: Array3f) -> MixedGloss:
        """β and γ (n,) at places of the lattice."""
        if self.shares is None:
            return MixedGloss(*(np.full(dr.width(place), each) for each in (self.beta, self.gamma)))
        return mixed_gloss(self.gloss, np.array(self.surface_field.share_at(place)))

    @cached_property
    def brightest(self) -> float:
        """Body colour of the brightest places of the surface; above 1 they would give back more than all light."""
        near = np.abs(self.distance) < 1.0
        return float(np.percentile(self.colours[near], BRIGHT)) if near.any() else 0.0

    @property
    def never_shown(self) -> float:
        """Share of the surface that no photograph shows lit; 0 where that is not known."""
        surface = np.abs(self.distance) < 0.5
        return 0.0 if self.evidence is None else float((self.evidence.photographs[surface] == 0).mean())

    @cached_property
    def explained(self) -> list[Explained]:
        """How well it explains each of the photographs that it was recovered from."""
        return [explained(self, photograph) for photograph in self.photographs]

    @property
    def beyond(self) -> float:
        """How far the outlines of the surface stand outside those of its masks [m], the mean of all photographs."""
        each = [one.beyond for one in self.explained if np.isfinite(one.beyond)]
        return float(np.mean(each)) if each and self.fuzzy is None else 0.0

    @property
    def dim(self) -> float:
        """Factor on the body colours of box and mesh, below 1 where the brightest ones are above 1."""
        return BRIGHTEST / self.brightest if self.brightest > 1.0 else 1.0

    @property
    def matter(self) -> Law:
        """The law of the matter."""
        return "surface" if self.fuzzy is None else "fuzzy"

    @cached_property
    def surface_field(self) -> DistanceField:
        """The surface on the device; of fuzzy matter the one that stands for it."""
        return DistanceField(self.distance, self.colours, self.shares)

    @cached_property
    def near_surface(self) -> NearSurface:
        """Places of the surface, and how much matter is behind them."""
        return NearSurface(self.surface_field)

    @cached_property
    def field(self) -> MatterField:
        """The matter on the device."""
        return self.surface_field if self.fuzzy is None else self.fuzzy.field()

    @cached_property
    def rendering(self) -> Rendering:
        """Its pictures."""
        held = self.field
        light = None if self.look.unknown is None else self.look.unknown.of(self.photographs[:1])
        shading = NodeShading(LampTable(self.photographs[:1], self.lattice), self.gloss, light, held.element)
        albedo = self.dim if self.orders == "all" else None
        return Rendering(held, shading, self.softness, bool(self.settings.get("shadows", True)), albedo=albedo)

    def picture(self, photograph: Photograph) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """What the camera of `photograph` would see under its lamps: light (h, w, 3), and opacity (h, w)."""
        return self.rendering.picture(photograph, self.lattice)

    def normals(self, photograph: Photograph) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Unit normals, or axes of fibres, that a photograph shows (h, w, 3), world axes, and the opacity (h, w)."""
        return self.rendering.normals(photograph, self.lattice)

    def places(self, photograph: Photograph) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Number (h, w) of the node of `distance`, `errors` … nearest to what a photograph shows, and the opacity."""
        return self.rendering.nodes(photograph, self.lattice)

    def record(self) -> dict[str, Any]:
        """What was found, as plain data: the file beside a box."""
        scores, look = self.scores(), self.look
        edges = np.array(self.lattice.shape[::-1]) * self.lattice.voxel
        materials = self.evidence.materials(self.gloss) if self.evidence and self.lit else []
        return {
            "hagoromo": written_by(dict(self.settings), self.settings.get("seed")),
            "name": self.name,
            "complete": self.complete,
            "lamps": "known" if self.lit else LIGHTS["even" if look.unknown is None else look.unknown.frame],
            "matter": self.matter,
            "matter_tried_db": dict(self.matter_tried),
            "lights_tried_db": dict(look.tried),
            "cameras": "as stated" if look.cameras is None else str(look.cameras),
            "strengths": "as stated" if look.strengths is None else str(look.strengths),
            "lamp_places": "as stated" if look.places is None else str(look.places),
            "masks_moved_px": self.masks.pixels if self.masks and self.masks.moved else 0.0,
            "silhouettes": "masks" if self.stated else "what is brighter than a dark background",
            "nodes": list(self.lattice.shape[::-1]),
            "voxel_m": self.lattice.voxel,
            "size_m": edges.tolist(),
            "photographs": len(self.photographs),
            "brightest_body_colour": self.brightest,
            "material": materials[0] if materials else None,
            "materials": materials,
            "gloss": self._gloss(),
            "gloss_tried_db": dict(self.gloss_tried),
            "orders": self.orders,
            "orders_tried_db": dict(self.orders_tried),
            "hollow": None if self.hollow is None else asdict(self.hollow),
            "errors": self._errors(),
            "remarks": remarks_on(self),
            "kept_aside": [score._asdict() for score in scores],
            "assumptions": dict(self.assumptions),
        }

    def _errors(self) -> dict[str, Any] | None:
        """Standard errors of places that photographs show, median and 95th percentile; the shares that none shows, and
        that are too thin for the lattice.
        """
        if self.errors is None or self.evidence is None:
            return None
        shown = np.isfinite(self.errors.position) & (self.evidence.photographs > 0)
        all_of = {
            "position_m": self.errors.position[shown],
            "normal_rad": self.errors.normal[shown],
            "body_colour": self.errors.colour[shown].ravel(),
        }
        if self.errors.gloss is not None:
            all_of |= {"ln_beta": self.errors.gloss[shown][:, 0], "ln_gamma": self.errors.gloss[shown][:, 1]}
        found = {key: np.quantile(v, (0.5, 0.95)).tolist() if v.size else None for key, v in all_of.items()}
        return {
            "quantiles": [0.5, 0.95],
            "of_lattice": self.errors.of_lattice,
            **found,
            "never_shown": self.never_shown,
            "too_thin": float(self.errors.thin[np.abs(self.distance) < 0.5].mean()),
        }

    def _gloss(self) -> dict[str, Any] | None:
        """β and γ of places that photographs show: their 5th, 50th and 95th percentiles; None: of the whole object."""
        if self.shares is None:
            return None
        there = np.abs(self.distance) < 0.5
        if self.evidence is not None and (there & (self.evidence.photographs > 0)).any():
            there &= self.evidence.photographs > 0
        found = mixed_gloss(self.gloss, self.shares[there])
        quantiles = (0.05, 0.5, 0.95)
        values = {name: np.quantile(each, quantiles).tolist() for name, each in found._asdict().items()}
        return {"quantiles": list(quantiles), **values, "share": np.quantile(self.shares[there], quantiles).tolist()}

    def scores(self) -> list[Score]:
        """How well the photographs that were kept aside are predicted, unscaled."""
        return [score(kept.photograph, kept.silhouette, self.picture(kept.photograph)[0]) for kept in self.kept]

    def box(self, side: int | None = None) -> VolumeBox:
        """The object as a volume box of `side` voxels along its longest edge (default: five a node; of fuzzy matter
        one).
        """
        from hagoromo_recovery.export import fuzzy_box, recovered_box

        return recovered_box(self, side) if self.fuzzy is None else fuzzy_box(self, self.fuzzy, side)

    def mesh(self) -> RecoveredMesh:
        """The surface as triangles; of fuzzy matter the one that stands for it."""
        from hagoromo_recovery.export import recovered_mesh

        return recovered_mesh(self)


def score(photograph: Photograph, silhouette: NDArray[np.bool_], light: NDArray[np.floating]) -> Score:
    """How near predicted light (h, w, 3) is to a photograph.

    What a mask leaves out is not the object, so there nothing should be predicted, whatever the photograph shows.
    """
    values = photograph.values.astype(np.float64)
    predicted = light[..., : values.shape[2]].astype(np.float64)
    valid = photograph.mask
    if photograph.silhouette is not None:
        valid, values = valid | ~silhouette, np.where(silhouette[..., None], values, 0.0)
    valid = valid & np.isfinite(values).all(axis=2)
    peak = float(values[valid].max())
    inside = valid & silhouette
    truth, found = values[valid], predicted[valid]
    factor = float((truth * found).sum() / max(float((found * found).sum()), 1e-30))
    return Score(
        photograph.name,
        _psnr(truth, found, peak),
        _psnr(values[inside], predicted[inside], peak),
        _psnr(truth, factor * found, peak),
    )


def _psnr(truth: NDArray, found: NDArray, peak: float) -> float:
    error = float(np.mean((truth - found) ** 2)) if truth.size else 0.0
    return float(10.0 * np.log10(peak * peak / max(error, 1e-30)))
