"""Archives: bags that the BagIt library validates and RO-Crates that its library reads, or one line of refusal."""

import hashlib
import io
import json
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest
from PIL import Image, ImageCms

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png

PROFILE = {"creator": "Ada Müller", "institution": "Museum of Robes", "licence": "CC-BY-4.0", "camera": "EOS R5"}
DC = "{http://purl.org/dc/elements/1.1/}"


@pytest.fixture
def home(tmp_path):
    """A result with what `measure` writes about itself, a page, and the original."""
    measured, capture = tmp_path / "measured", tmp_path / "capture"
    for folder in (measured / "maps", capture):
        folder.mkdir(parents=True)
    by = {"format_version": 1, "version": "0.3.0", "settings": {"distance_m": 0.6}}
    (measured / "materials.json").write_text(json.dumps([{"hagoromo": by}]), encoding="utf-8")
    (measured / "maps" / "größe 1.exr").write_bytes(b"\x76\x2f\x31\x01 not looked at")
    (measured / ".hagoromo").touch()
    (tmp_path / "page.html").write_text("<p>page</p>", encoding="utf-8")
    (capture / "lamp 1.dng").write_bytes(b"raw")
    return tmp_path


def _archived(home, out="bag", **settings):
    given: dict[str, Any] = {
        "inventory": "1889.12",
        "title": "Robe",
        "photographed": "2026-11-27",
        "originals": [home / "capture"],
    }
    results = settings.pop("results", [home / "measured", home / "page.html"])
    return hg.archive(results, home / out, hg.ArchiveProfile(**PROFILE), **(given | settings))


def test_a_bag_is_valid_and_every_file_has_its_digest(home):
    holdings = _archived(home)
    bag_utils = pytest.importorskip("bagit_utils", reason="a judge of the developers")
    bag = bag_utils.Bag(home / "bag")
    report = bag.validate()
    assert report.valid, [(one.level, one.message) for one in report.issues]
    assert bag.baginfo["External-Identifier"] == ["1889.12"]
    assert bag.baginfo["Source-Organization"] == ["Museum of Robes"]
    for one in holdings:
        file = home / "bag" / "data" / one.path if one.kept else home / one.path
        assert hashlib.sha256(file.read_bytes()).hexdigest() == one.sha256 and file.stat().st_size == one.size
    assert [one.path for one in holdings if not one.kept] == ["capture/lamp 1.dng"]
    assert not (home / "bag" / "data" / "capture").exists()
    (home / "bag" / "data" / "page.html").write_text("other", encoding="utf-8")
    assert not bag_utils.Bag(home / "bag").validate().valid


def test_the_library_of_congress_validates_a_bag_of_odd_names(home):
    """By its own tool, which has no wheel and so is seldom there."""
    bagit = pytest.importorskip("bagit", reason="only from source")
    (home / "measured" / " 100 - #&? bright .txt").write_text("a", encoding="utf-8")
    _archived(home, pack=True)
    bagit.Bag(str(home / "bag")).validate()


def test_the_manifest_is_that_of_the_specification(home):
    """RFC 8493: each line a digest, two blanks and a path; the tag manifest covers the manifest."""
    (home / "measured" / " 100 - #&? bright .txt").write_text("a", encoding="utf-8")
    _archived(home)
    manifest = (home / "bag" / "manifest-sha256.txt").read_text(encoding="utf-8")
    assert f"{hashlib.sha256(b'a').hexdigest()}  data/measured/ 100 - #&? bright .txt\n" in manifest
    files = [one for one in (home / "bag" / "data").rglob("*") if one.is_file()]
    assert manifest.count("\n") == len(files)
    tags = (home / "bag" / "tagmanifest-sha256.txt").read_text(encoding="utf-8")
    assert f"{hashlib.sha256(manifest.encode()).hexdigest()}  manifest-sha256.txt" in tags
    octets = sum(one.stat().st_size for one in files)
    assert f"Payload-Oxum: {octets}.{len(files)}" in (home / "bag" / "bag-info.txt").read_text(encoding="utf-8")


def test_a_library_reads_the_crate(home):
    rocrate = pytest.importorskip("rocrate.rocrate", reason="a judge of the developers")
    _archived(home)
    crate = rocrate.ROCrate(str(home / "bag" / "data"))
    assert crate.name == "Robe" and crate.root_dataset["identifier"] == "1889.12"
    assert crate.root_dataset["license"].id == "https://spdx.org/licenses/CC-BY-4.0"
    parts = {part.id for part in crate.root_dataset["hasPart"]}
    assert parts == {"measured/materials.json", "measured/maps/gr%C3%B6%C3%9Fe%201.exr", "page.html"}
    (made,) = [one for one in crate.contextual_entities if one.type == "CreateAction"]
    assert '"distance_m": 0.6' in made["description"] and made["result"].id == "measured/materials.json"
    assert {one.id for one in made["instrument"]} == {"#hagoromo", "#camera"}
    (source,) = made["object"] if isinstance(made["object"], list) else [made["object"]]
    assert source["sha256"] == hashlib.sha256(b"raw").hexdigest()


def test_every_reference_of_the_crate_leads_somewhere(home):
    """By the specification: one flat graph, each @id once, the descriptor first, every local reference defined."""
    _archived(home, pack=True)
    data = home / "bag" / "data"
    graph = json.loads((data / "ro-crate-metadata.json").read_text(encoding="utf-8"))["@graph"]
    names = [one["@id"] for one in graph]
    assert len(set(names)) == len(names) and graph[0]["about"] == {"@id": "./"}

    def references(value):
        if isinstance(value, dict):
            yield from [value["@id"]] if set(value) == {"@id"} else [r for v in value.values() for r in references(v)]
        elif isinstance(value, list):
            yield from (reference for one in value for reference in references(one))

    found = {
        reference for one in graph for key, value in one.items() if key != "@id" for reference in references(value)
    }
    assert found - set(names) == {"https://w3id.org/ro/crate/1.1"}
    assert (data / "originals" / "capture" / "lamp 1.dng").read_bytes() == b"raw"


def test_a_result_is_made_from_the_files_whose_digests_it_states(home):
    """A file of the archive, one that is only referenced, and one that nobody gave."""
    held = {"page.html": (home / "page.html").read_bytes(), "lamp 1.dng": b"raw", "dome.lp": b"lost"}
    stated = [{"name": name, "sha256": hashlib.sha256(bytes).hexdigest()} for name, bytes in held.items()]
    by = {"format_version": 1, "version": "0.3.0", "sources": stated}
    (home / "measured" / "materials.json").write_text(json.dumps([{"hagoromo": by}]), encoding="utf-8")
    _archived(home)
    graph = json.loads((home / "bag" / "data" / "ro-crate-metadata.json").read_text(encoding="utf-8"))["@graph"]
    (action,) = [one for one in graph if one["@type"] == "CreateAction"]
    named = {one["@id"]: one["name"] for one in graph if "name" in one}
    assert [named[one["@id"]] for one in action["object"]] == ["page.html", "capture/lamp 1.dng", "dome.lp"]
    assert action["object"][0]["@id"] == "page.html"
    assert action["object"][2]["@id"] == f"urn:sha256:{stated[2]['sha256']}"


def test_dublin_core_says_who_what_and_when(home):
    _archived(home)
    root = ElementTree.parse(home / "bag" / "data" / "dublin_core.xml").getroot()
    said = {key: root.findtext(DC + key) for key in ("title", "identifier", "creator", "publisher", "date")}
    assert said == {"title": "Robe", "identifier": "1889.12", "creator": "Ada Müller", "publisher": "Museum of Robes",
                    "date": "2026-11-27"}  # fmt: skip
    assert hashlib.sha256(b"raw").hexdigest() in (root.findtext(DC + "source") or "")


def test_a_profile_is_asked_once(tmp_path):
    from hagoromo_formats.archive.profile import known_profile

    asked, place = [], tmp_path / "settings" / "archive.toml"

    def answer(question):
        asked.append(question)
        return {"Who": "Ada Müller", "Ins": "Museum", "Lic": "CC0-1.0"}.get(question[:3], "")

    first = known_profile(place, answer)
    count = len(asked)
    assert count == 8 and known_profile(place, answer) == first == known_profile(place, None) and len(asked) == count


def test_what_cannot_be_archived_is_refused_in_one_line(home, capsys):
    (home / "profile.toml").write_text('creator = "A"\ninstitution = "M"\nlicence = "CC0-1.0"\n', encoding="utf-8")
    (home / "short.toml").write_text('creator = "A"\n', encoding="utf-8")
    (home / "other").mkdir()
    (home / "other" / "page.html").touch()
    (home / "linked").mkdir()
    (home / "linked" / "a").symlink_to(home / "page.html")
    (home / "odd").mkdir()
    (home / "odd" / "100 %.txt").touch()
    page, complete = str(home / "page.html"), ["--profile", str(home / "profile.toml"), "--inventory", "1"]
    cases = {
        "no inventory number": [page, "--profile", str(home / "profile.toml")],
        "lacks institution, licence": [page, "--profile", str(home / "short.toml"), "--inventory", "1"],
        "no terminal to ask at": [page, "--profile", str(home / "none.toml"), "--inventory", "1"],
        "give it as 2026-11-27": [page, *complete, "--date", "27.11."],
        "does not exist": [str(home / "absent"), *complete],
        "is a link": [str(home / "linked"), *complete],
        "% or an end of line": [str(home / "odd"), *complete],
        "two of the results": [page, str(home / "other" / "page.html"), *complete],
    }
    for said, words in cases.items():
        assert main(["archive", *words, "--out", str(home / "out")]) == 2, said
        error = capsys.readouterr().err
        assert said in error and error.count("\n") == 1 and not (home / "out").exists()
    assert main(["archive", page, *complete, "--out", str(home / "out")]) == 0
    assert Path(home / "out" / "data" / "page.html").exists()


@pytest.fixture
def pictured(home):
    """With a picture of odd size and normals, as a measurement has them."""
    random = np.random.default_rng(5)
    wide = np.kron(random.integers(0, 255, (9, 17, 3)), np.ones((130, 70, 1))).astype(np.uint8)[:1101, :1187]
    write_png(home / "measured" / "raking 1.png", wide, srgb=True)
    normals = np.zeros((23, 31, 3), np.float32)
    normals[..., 2] = 1.0
    write_exr(home / "measured" / "normals.exr", {f"N.{axis}": normals[..., k] for k, axis in enumerate("XYZ")})
    body = np.full((23, 31, 3), (0.3, 0.2, 0.1), np.float32) / np.pi
    write_exr(home / "measured" / "body.exr", {name: body[..., k] for k, name in enumerate("RGB")})
    return home, wide


def test_pictures_have_their_profile_and_who_made_them(pictured):
    home, wide = pictured
    _archived(home)
    made = Image.open(home / "bag" / "data" / "pictures" / "measured" / "raking 1.png")
    assert np.array_equal(np.array(made), wide)
    assert ImageCms.ImageCmsProfile(io.BytesIO(made.info["icc_profile"])).profile.xcolor_space.strip() == "RGB"
    packet = ElementTree.fromstring(made.info["XML:com.adobe.xmp"].split("?>", 1)[1].rsplit("<?", 1)[0])
    said = {element.tag.split("}")[1]: " ".join(element.itertext()) for element in packet.iter()}
    assert said["creator"] == "Ada Müller" and said["identifier"] == "1889.12"
    assert said["WebStatement"] == "https://spdx.org/licenses/CC-BY-4.0"
    normals = np.array(Image.open(home / "bag" / "data" / "pictures" / "measured" / "normals.png"))
    assert normals.shape == (23, 31, 3) and (normals == (128, 128, 255)).all()
    body = np.array(Image.open(home / "bag" / "data" / "pictures" / "measured" / "body.png"))
    assert body[0, 0].tolist() == hg.srgb_encode(np.array([0.3, 0.2, 0.1])).tolist()
    assert not (home / "bag" / "data" / "iiif").exists()


def test_a_manifest_of_iiif_is_read_by_a_library(pictured):
    home, _ = pictured
    _archived(home, iiif="https://museum.org/iiif/1")
    text = (home / "bag" / "data" / "iiif" / "manifest.json").read_text(encoding="utf-8")
    record = json.loads(text)
    assert record["rights"] == "http://creativecommons.org/licenses/by/4.0/"
    canvases = {one["label"]["none"][0]: one for one in record["items"]}
    assert set(canvases) == {"measured/raking 1", "measured/normals", "measured/body"}
    body = canvases["measured/normals"]["items"][0]["items"][0]["body"]
    at = body["id"].removeprefix("https://museum.org/iiif/1/")
    assert (home / "bag" / "data" / "iiif" / at).is_file()
    prezi = pytest.importorskip("iiif_prezi3", reason="asks for an older Pillow")
    prezi.Manifest(**record)


@pytest.mark.parametrize("address", ["museum.org/1", "ftp://museum.org", "https://museum.org/1?x=2"])
def test_an_address_of_iiif_that_is_none_is_refused(home, address):
    with pytest.raises(hg.InputError, match="--iiif is"):
        _archived(home, iiif=address)
