"""glTF's JSON as it is read: types, ranges and numbers of entries (Khronos glTF 2.0, 5), checked once for all readers.

What is not listed here is not read. Entries of lists are numbered; a number that no entry has is refused.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Annotated, Any

from msgspec import Meta

from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.files.record import ForeignRecord, about, decode, json_value

MOST_NODES = 1 << 16  # places at which meshes and lines may stand
BYTES_PER_ENTRY = 300.0  # memory of a corner or an index, at every place where it stands
# extensions without which a file may say that it cannot be shown. Of materials what is not read is said to be lost
READ = ("KHR_lights_punctual", "KHR_texture_transform", "KHR_mesh_quantization")
READ_OF = "KHR_materials_"
BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}  # of a componentType
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}  # numbers of a type
FLOAT, NEVER_FRACTIONS = 5126, ("POSITION", "TEXCOORD_0")  # which would be taken for the whole numbers
SHOWN = ("POSITION", "TEXCOORD_0", "COLOR_0", "NORMAL")  # attributes that are read
Number = Annotated[int, Meta(ge=0, le=2**31 - 1), about("number of an entry of another list")]
Size = Annotated[int, Meta(ge=0, le=2**53), about("bytes, or a count")]
Factor = Annotated[float, Meta(ge=0.0)]
Colour = Annotated[tuple[float, ...], Meta(min_length=3, max_length=4)]


class Texture(ForeignRecord, frozen=True, kw_only=True):
    """Where a material names a texture."""

    index: Number
    texCoord: Number = 0
    extensions: dict[str, dict[str, Any]] = {}


class MetallicRoughness(ForeignRecord, frozen=True, kw_only=True):
    """pbrMetallicRoughness."""

    baseColorFactor: Annotated[tuple[float, ...], Meta(min_length=4, max_length=4)] = (1.0, 1.0, 1.0, 1.0)
    metallicFactor: float = 1.0
    roughnessFactor: float = 1.0
    baseColorTexture: Texture | None = None
    metallicRoughnessTexture: Texture | None = None


class Specular(ForeignRecord, frozen=True, kw_only=True):
    """KHR_materials_specular."""

    specularFactor: float = 1.0
    specularColorFactor: Colour = (1.0, 1.0, 1.0)
    specularTexture: Texture | None = None
    specularColorTexture: Texture | None = None


class Ior(ForeignRecord, frozen=True, kw_only=True):
    """KHR_materials_ior."""

    ior: Factor = 1.5


class Transmission(ForeignRecord, frozen=True, kw_only=True):
    """KHR_materials_transmission."""

    transmissionFactor: float = 0.0


class MaterialExtensions(ForeignRecord, frozen=True, kw_only=True):
    """Those of a material that are read."""

    KHR_materials_specular: Specular | None = None
    KHR_materials_ior: Ior | None = None
    KHR_materials_transmission: Transmission | None = None


class Material(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `materials`."""

    name: str = ""
    pbrMetallicRoughness: MetallicRoughness | None = None
    emissiveFactor: Annotated[tuple[float, ...], Meta(min_length=3, max_length=3)] | None = None
    extensions: MaterialExtensions | None = None


class Primitive(ForeignRecord, frozen=True, kw_only=True):
    """A part of a mesh; attributes: name → number of an accessor."""

    attributes: dict[str, Number] = {}
    indices: Number | None = None
    material: Number | None = None
    mode: Annotated[int, Meta(ge=0, le=6)] = 4


class GltfMesh(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `meshes`."""

    name: str = ""
    primitives: list[Primitive]


class Light(ForeignRecord, frozen=True, kw_only=True):
    """The number of a lamp, at a node."""

    light: Number


class NodeExtensions(ForeignRecord, frozen=True, kw_only=True):
    """Those of a node that are read."""

    KHR_lights_punctual: Light | None = None


class Node(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `nodes`."""

    name: str = ""
    children: list[Number] = []
    mesh: Number | None = None
    camera: Number | None = None
    matrix: Annotated[tuple[float, ...], Meta(min_length=16, max_length=16)] | None = None
    translation: tuple[float, float, float] | None = None
    rotation: tuple[float, float, float, float] | None = None
    scale: tuple[float, float, float] | None = None
    extensions: NodeExtensions | None = None


class GltfScene(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `scenes`."""

    nodes: list[Number] = []


class Accessor(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `accessors`: numbers in a bufferView."""

    bufferView: Number | None = None
    byteOffset: Size = 0
    componentType: Annotated[int, Meta(ge=5120, le=5126)]
    count: Size
    type: str
    normalized: bool = False
    sparse: dict[str, Any] | None = None


class BufferView(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `bufferViews`."""

    buffer: Number
    byteOffset: Size = 0
    byteLength: Size
    byteStride: Size | None = None


class Buffer(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `buffers`."""

    byteLength: Size
    uri: str | None = None


class GltfImage(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `images`."""

    uri: str | None = None
    bufferView: Number | None = None


class TextureSource(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `textures`."""

    source: Number | None = None
    sampler: Number | None = None


class Sampler(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `samplers`."""

    magFilter: Number | None = None
    wrapS: Number = 10497
    wrapT: Number = 10497


class Perspective(ForeignRecord, frozen=True, kw_only=True):
    """The lens of a camera."""

    yfov: Annotated[float, Meta(gt=0.0, lt=3.1415926)]
    aspectRatio: Annotated[float, Meta(gt=0.0, le=1e4)] = 4 / 3


class View(ForeignRecord, frozen=True, kw_only=True):
    """An entry of `cameras`."""

    name: str = ""
    type: str = ""
    perspective: Perspective | None = None


class GltfSpot(ForeignRecord, frozen=True, kw_only=True):
    """The cone of a spot."""

    innerConeAngle: Factor = 0.0
    outerConeAngle: Factor = 0.7853982


class GltfLamp(ForeignRecord, frozen=True, kw_only=True):
    """A lamp of KHR_lights_punctual."""

    name: str = ""
    type: str = "point"
    color: Colour = (1.0, 1.0, 1.0)
    intensity: Factor = 1.0
    spot: GltfSpot | None = None


class GltfLamps(ForeignRecord, frozen=True, kw_only=True):
    """KHR_lights_punctual."""

    lights: list[GltfLamp] = []


class Extensions(ForeignRecord, frozen=True, kw_only=True):
    """Those of the file that are read."""

    KHR_lights_punctual: GltfLamps | None = None


class Gltf(ForeignRecord, frozen=True, kw_only=True):
    """A file."""

    extensionsRequired: list[str] = []
    scene: Number = 0
    scenes: list[GltfScene] = []
    nodes: Annotated[list[Node], Meta(max_length=MOST_NODES)] = []
    meshes: list[GltfMesh] = []
    materials: list[Material] = []
    accessors: list[Accessor] = []
    bufferViews: list[BufferView] = []
    buffers: list[Buffer] = []
    images: list[GltfImage] = []
    textures: list[TextureSource] = []
    samplers: list[Sampler] = []
    cameras: list[View] = []
    extensions: Extensions | None = None


def checked(text: bytes, where: str) -> dict[str, Any]:
    """The JSON of a glTF, of which everything that is read has its type and names entries that there are.

    `InputError` for another one, for an extension that is required and not read, and for what would not fit the memory.
    """
    record = json_value(text, where)
    gltf = decode(record, Gltf, where)
    for name in gltf.extensionsRequired:
        if name not in READ and not name.startswith(READ_OF):
            raise InputError(f"{where} needs the extension {name:.60}, which is not read: export it without")
    for place, kind, number in _named(gltf):
        if number >= len(entries := getattr(gltf, kind)):
            raise InputError(
                f"{where}: {place} is number {number} of {kind}, of which there are {len(entries)}: mend it"
            )
    parts = [part for mesh in gltf.meshes for part in mesh.primitives]
    for number in {number for part in parts for number in _read_of(part)}:
        _check_accessor(gltf, number, where)
    for number in {part.attributes[name] for part in parts for name in NEVER_FRACTIONS if name in part.attributes}:
        if gltf.accessors[number].normalized and gltf.accessors[number].componentType != FLOAT:
            raise InputError(f"{where}: accessor {number} has whole numbers for fractions: export it as floats")
    counts = [accessor.count for accessor in gltf.accessors]
    sizes = [float(sum(counts[k] for part in mesh.primitives for k in _read_of(part))) for mesh in gltf.meshes]
    placed = sum(sizes[node.mesh] for node in gltf.nodes if node.mesh is not None)
    require(BYTES_PER_ENTRY * (sum(sizes) + placed), where)
    return record


def _read_of(part: Primitive) -> Iterator[int]:
    """The accessors of a primitive that are read."""
    yield from (part.attributes[name] for name in SHOWN if name in part.attributes)
    if part.indices is not None:
        yield part.indices


def _check_accessor(gltf: Gltf, number: int, where: str) -> None:
    """`InputError` for one whose numbers are not where it says: extensions pack them, sparse ones are spread."""
    accessor, what = gltf.accessors[number], f"{where}: accessor {number}"
    if accessor.sparse is not None or accessor.bufferView is None:
        raise InputError(f"{what} is sparse, or packed by an extension: export the file without either")
    view = gltf.bufferViews[accessor.bufferView]
    each = BYTES.get(accessor.componentType, 0) * WIDTHS.get(accessor.type, 0)
    stride = each if view.byteStride is None else view.byteStride
    end = accessor.byteOffset + (accessor.count - 1) * stride + each
    whole = gltf.buffers[view.buffer].byteLength
    if not each or stride < each or end > view.byteLength or view.byteOffset + view.byteLength > whole:
        raise InputError(f"{what} states {accessor.count} {accessor.type:.10} and does not hold them: it is damaged")


def _named(gltf: Gltf) -> Iterator[tuple[str, str, int]]:
    """All index numbers that are read: the place of each, the list that it points into, and the number."""
    named: list[tuple[str, str, int | None]] = [("scene", "scenes", gltf.scene if gltf.scenes else None)]
    for k, stage in enumerate(gltf.scenes):
        named += [(f"a node of scene {k}", "nodes", number) for number in stage.nodes]
    for k, node in enumerate(gltf.nodes):
        named += [(f"a child of node {k}", "nodes", number) for number in node.children]
        named += [(f"the mesh of node {k}", "meshes", node.mesh), (f"the camera of node {k}", "cameras", node.camera)]
    for k, mesh in enumerate(gltf.meshes):
        for part in mesh.primitives:
            named += [(f"an array of mesh {k}", "accessors", number) for number in part.attributes.values()]
            named += [(f"an array of mesh {k}", "accessors", part.indices)]
            named += [(f"the material of mesh {k}", "materials", part.material)]
    named += [
        (f"the bufferView of accessor {k}", "bufferViews", each.bufferView) for k, each in enumerate(gltf.accessors)
    ]
    named += [(f"the buffer of bufferView {k}", "buffers", each.buffer) for k, each in enumerate(gltf.bufferViews)]
    named += [(f"the bufferView of image {k}", "bufferViews", each.bufferView) for k, each in enumerate(gltf.images)]
    for k, texture in enumerate(gltf.textures):
        named += [(f"the image of texture {k}", "images", texture.source)]
        named += [(f"the sampler of texture {k}", "samplers", texture.sampler)]
    for k, material in enumerate(gltf.materials):
        named += [(f"a texture of material {k}", "textures", texture.index) for texture in _textures(material)]
    yield from ((place, kind, number) for place, kind, number in named if number is not None)


def _textures(material: Material) -> list[Texture]:
    rough, more = material.pbrMetallicRoughness, material.extensions
    specular = None if more is None else more.KHR_materials_specular
    found = [] if rough is None else [rough.baseColorTexture, rough.metallicRoughnessTexture]
    found += [] if specular is None else [specular.specularTexture, specular.specularColorTexture]
    return [texture for texture in found if texture is not None]
