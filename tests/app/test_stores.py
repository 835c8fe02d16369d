"""Boxes, captures and results in a store: a local S3 server gives and takes them; what is lost there is one line."""

import os
import shutil
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.batch.batch import stamp
from hagoromo.app.cli import main
from hagoromo.files import stores
from hagoromo.files.zarr_arrays import open_arrays
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store import packed_bricks
from hagoromo.volume.store.box_store import look_at_box


@pytest.fixture(scope="module")
def s3():
    """The address of an empty bucket of an S3 server on loopback; what is needed to reach it is in the environment."""
    from moto.server import ThreadedMotoServer

    keys = {"AWS_ACCESS_KEY_ID": "of", "AWS_SECRET_ACCESS_KEY": "nobody", "AWS_DEFAULT_REGION": "us-east-1"}
    server = ThreadedMotoServer(ip_address="127.0.0.1", port=0, verbose=False)
    server.start()
    with pytest.MonkeyPatch.context() as patch:
        host, port = server.get_host_and_port()
        for key, value in (keys | {"AWS_ENDPOINT_URL": f"http://{host}:{port}"}).items():
            patch.setenv(key, value)
        stores._files.cache_clear()
        stores._files("s3").mkdir("bucket")
        yield "s3://bucket"
        forget_sessions()
        server.stop()


def forget_sessions() -> None:
    """Close what fsspec and zarr-python have opened, each in its own event loop."""
    from fsspec.asyn import sync
    from s3fs import S3FileSystem
    from zarr.core.sync import sync as sync_of_zarr

    for files in list(S3FileSystem._cache.values()):
        if files._s3 is not None and files.asynchronous:
            sync_of_zarr(files._s3.__aexit__(None, None, None))
        elif files._s3 is not None:
            sync(files.loop, files._s3.__aexit__, None, None, None)
    S3FileSystem.clear_instance_cache()
    stores._files.cache_clear()


@pytest.fixture
def stored(box, s3):
    """A box on disk, and the address of the same in the store."""
    stores.put(box, f"{s3}/{box.parent.name}/slab.zarr")
    return box, f"{s3}/{box.parent.name}/slab.zarr"


def test_a_box_in_a_store_has_the_bits_of_the_one_on_disk(stored, scene, tmp_path, capsys):
    """Loaded, looked at, and rendered by a scene on disk that names it."""
    box, address = stored
    near, far = hg.load_box(box), hg.load_box(address)
    for name in ("density", "axis"):
        values = [np.array(getattr(one.bricks, name).values) for one in (near, far)]
        assert values[0].size and (values[0] == values[1]).all()
    assert str(look_at_box(address)) == str(look_at_box(box))
    assert main(["info", address]) == 0 and "volume box" in capsys.readouterr().out
    pictures = []
    for place in ("slab.zarr", address):
        path = scene(more=f'\n[[box]]\nfile = "{place}"\nposition = [-0.1, -0.2, 0.0]\n')
        pictures.append(hg.render(path).weights)
    assert pictures[0].max() > 0 and (pictures[0] == pictures[1]).all()


def test_only_the_packed_bricks_and_ends_of_chunks_are_fetched(stored):
    """Opening reads each packed chunk once and the last four bytes of the other chunks, not the chunks.

    Descriptions of groups and arrays, of 4 kB together, are read twice: once to check their types.
    """
    box, address = stored
    stores.traffic.clear()
    hg.load_box(address)
    sizes = {file.relative_to(box).as_posix(): file.stat().st_size for file in box.rglob("*") if file.is_file()}
    packed = sum(size for name, size in sizes.items() if name.startswith("packed/") and "/c/" in name)
    assert packed < stores.traffic["bytes"] < packed + 2 * 4096
    stores.traffic.clear()
    look_at_box(address)
    assert stores.traffic["bytes"] < 2 * 4096


BAR = """
[camera]
size = [13, 11]
focal = [60.0, 60.0]
eye = [0.01, -0.12, 0.012]
target = [0.01, 0.0, 0.012]
[[lamp]]
%s
[[box]]
file = "%s"
[render]
samples = 2
shadows = "%s"
"""
ACROSS, ALONG = (0.05, 0.45), (0.8, 1.01)  # share of the bytes of the whole box
LAMPS = {
    "to_lamp = [0.2, -1.0, 0.4]": ACROSS,
    "position = [0.02, -0.2, 0.05]\nintensity = 0.02": ACROSS,
    "to_lamp = [1.2, -1.0, 0.1]": (0.45, 0.8),
    "to_lamp = [1.0, -0.02, 0.02]": ALONG,
    "position = [0.4, 0.012, 0.012]\nintensity = 0.2": ALONG,
}


@pytest.fixture(scope="module")
def bar(s3, tmp_path_factory):
    """A bar of uneven matter, 24 × 24 × 192 mm, in chunks of nine bricks; the address of it in the store."""
    density = np.random.default_rng(5).random((24, 24, 192)).astype(np.float32)
    axis = np.broadcast_to([0.0, -1.0, 0.0], (*density.shape, 3))
    matter = hg.Reflectance(0.2, 0.1, 0.3, 1.5, hg.Spectrum.constant(1.0))
    box = VolumeBox.from_arrays(np.where(density > 0.4, density, 0.0), axis, 1e-3, 30.0, [matter])
    folder = tmp_path_factory.mktemp("bar")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(packed_bricks, "BRICKS_PER_CHUNK", 9)
        box.save(folder / "bar.zarr")
    stores.put(folder / "bar.zarr", f"{s3}/bar.zarr")
    return f"{s3}/bar.zarr"


@pytest.mark.parametrize(
    ("lamp", "shadows"),
    [
        *(pytest.param(lamp, "map", marks=[pytest.mark.nightly] * (k != 3)) for k, lamp in enumerate(LAMPS)),
        *(pytest.param(lamp, "march", marks=pytest.mark.nightly) for lamp in LAMPS),
        pytest.param(list(LAMPS)[-1], "none", marks=pytest.mark.nightly),
    ],
)
def test_only_the_bricks_that_a_picture_takes_are_fetched(bar, tmp_path, lamp, shadows):
    """The camera sees a ninth of a bar. Light along the bar passes all of it, and so nearly all is fetched."""
    path = tmp_path / "scene.toml"
    path.write_text(BAR % (lamp, bar, shadows))
    stores.traffic.clear()
    scene, settings = hg.load_scene(path)
    whole = stores.traffic["bytes"]
    stores.traffic.clear()
    image = hg.render(path)
    share = stores.traffic["bytes"] / whole
    least, most = (0.8, 1.01) if "bar" in lamp + " bar" * ("end" in lamp) and shadows != "none" else (0.05, 0.45)
    least, most = ACROSS if shadows == "none" else LAMPS[lamp]
    assert least < share < most, share
    expected = hg.render(scene, settings)
    assert expected.weights.max() > 0 and image.metadata == expected.metadata
    error = np.abs(image.weights - expected.weights).max() / expected.weights.max()
    assert error < 1e-5
    np.testing.assert_allclose(image.alpha, expected.alpha, atol=1e-5)


FILM = """
each = "frames/*.toml"
[[step]]
name = "rendered"
verb = "render"
arguments = ["{path}"]
out = "{name}.exr"
"""


@pytest.fixture
def keeping(monkeypatch):
    """What is fetched is kept for the time of a test."""
    monkeypatch.setattr(stores, "kept", stores.Kept())


@pytest.mark.nightly
def test_frames_of_a_film_fetch_a_box_once(bar, tmp_path, monkeypatch, keeping):
    """Two frames of one view under a lamp that moves; with nothing kept, twice as much."""
    (tmp_path / "frames").mkdir()
    for number in range(2):
        text = BAR % (f"to_lamp = [0.{number}, -1.0, 0.4]", bar, "none")
        (tmp_path / "frames" / f"{number}.toml").write_text(text)
    (tmp_path / "film.toml").write_text(FILM)
    fetched = []
    for megabytes in ("0", "10"):
        monkeypatch.setenv(stores.KEPT_MB, megabytes)
        stores.traffic.clear()
        outcomes = hg.batch(tmp_path / "film.toml", tmp_path / megabytes)
        assert [outcome.state for outcome in outcomes] == ["done"] * 2
        fetched.append(stores.traffic["bytes"])
    assert fetched[1] < 0.6 * fetched[0]
    assert stores.kept.bytes == stores.kept.most == 0  # once the film is done
    for number in range(2):
        once, again = (hg.read_image(tmp_path / kept / f"{number}.exr").weights for kept in ("0", "10"))
        assert (once == again).all() and once.max() > 0


def test_what_is_kept_is_bounded_and_follows_the_store(stored, keeping, monkeypatch):
    _, address = stored
    monkeypatch.setenv(stores.KEPT_MB, "1")
    stores.keep_fetched()
    name, place = f"{address}/zarr.json", address.removeprefix("s3://") + "/zarr.json"
    first = stores.read_whole(name)
    stores.traffic.clear()
    assert stores.read_whole(name) == first and not stores.traffic
    stores._files("s3").pipe_file(place, first + b" ")
    assert stores.read_whole(name) == first + b" " and stores.traffic["objects"] == 1
    for number in range(5):
        stores.kept.put(f"s3://bucket/{number}", "tag", bytes(300_000))
    assert stores.kept.bytes == 900_000 and stores.kept.get("s3://bucket/1", "tag") is None
    assert stores.kept.get("s3://bucket/4", "tag") and stores.kept.get("s3://bucket/4", "other") is None
    stores.kept.put("s3://bucket/whole", "tag", bytes(2_000_000))
    assert stores.kept.bytes == 900_000
    monkeypatch.setenv(stores.KEPT_MB, "much")
    stores.kept.most = 0
    with pytest.raises(hg.InputError, match="HAGOROMO_KEPT_MB is 'much'"):
        stores.keep_fetched()


def test_a_capture_is_measured_from_and_into_a_store(capture, s3, tmp_path, capsys):
    address, out = f"{s3}/{tmp_path.name}/capture", f"{s3}/{tmp_path.name}/measured"
    stores.put(capture, address)
    assert main(["measure", address, "--out", out]) == 0
    assert f"wrote {out}/report.html" in capsys.readouterr().out
    assert main(["measure", str(capture), "--out", str(tmp_path / "measured")]) == 0
    held = stores.sizes(out)
    assert set(held) == {f.relative_to(tmp_path / "measured").as_posix() for f in (tmp_path / "measured").rglob("*.*")}
    materials = stores.read_whole(f"{out}/materials.json", 1e6)
    assert materials == (tmp_path / "measured" / "materials.json").read_bytes()
    capsys.readouterr()
    assert main(["measure", address, "--out", out]) == 2
    assert "exists: choose another name or add force" in capsys.readouterr().err
    assert stores.sizes(out) == held


def test_a_box_is_built_and_a_picture_rendered_into_a_store(recipe, scene, s3, tmp_path):
    (tmp_path / "skin.toml").write_text(recipe.replace("size_mm = 6.0", "size_mm = 2.0\nvoxel_mm = 0.1"))
    box, picture = f"{s3}/{tmp_path.name}/skin.zarr", f"{s3}/{tmp_path.name}/a.exr"
    assert main(["build", str(tmp_path / "skin.toml"), "--out", box]) == 0
    assert main(["build", str(tmp_path / "skin.toml"), "--out", str(tmp_path / "skin.zarr")]) == 0
    for name in stores.sizes(box):
        assert stores.read_whole(f"{box}/{name}", 1e9) == (tmp_path / "skin.zarr" / name).read_bytes()
    assert main(["render", str(scene("size = [61, 47]", "size = [13, 11]")), "--out", picture]) == 0
    assert stores.is_file(picture) and stores.is_file(picture.replace(".exr", ".png"))


def test_a_folder_that_was_cut_off_is_no_result(stored, tmp_path, monkeypatch):
    """The upload dies before its last object, over an older box: no reader takes the rest for a box."""
    box, address = stored
    put_file, count = stores._files("s3").put_file, []

    def dies(*args):
        count.append(args)
        if len(count) == 6:
            raise ConnectionResetError("reset by peer")
        return put_file(*args)

    monkeypatch.setattr(stores._files("s3"), "put_file", dies)
    with pytest.raises(hg.InputError, match="cannot be reached: reset by peer"):
        stores.put(box, address)
    assert len(stores.sizes(address)) == 5
    with pytest.raises(hg.InputError, match="is no volume box"):
        hg.load_box(address)
    monkeypatch.setattr(stores._files("s3"), "put_file", put_file)
    stores.check_free(address, force=False)
    stores.put(box, address)
    assert str(look_at_box(address)) == str(look_at_box(box))


@pytest.mark.parametrize("lost", ["density/c/0/0/0", "packed/density/c/0/0/0/0"])
def test_a_box_that_is_damaged_in_the_store_is_one_line(stored, refused, scene, tmp_path, lost):
    box, address = stored
    file = next(file for file in sorted(box.rglob("*")) if file.as_posix().endswith(f"slab.zarr/{lost}"))
    stores._files("s3").pipe_file(f"{address.removeprefix('s3://')}/{lost}", file.read_bytes()[:-1])
    if lost.startswith("density"):
        shutil.rmtree(box / "packed")
        stores._files("s3").rm(f"{address.removeprefix('s3://')}/packed", recursive=True)
    path = scene(more=f'\n[[box]]\nfile = "{address}"\n')
    said = refused("render", path, "--out", tmp_path / "a.exr")
    assert "the file is damaged" in said and address in said


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("info", "s3://bucket/none.zarr"), "is no volume box"),
        (("measure", "s3://bucket/none", "--out", "{}/a"), "s3://bucket/none does not exist"),
        (("measure", "s3://nobody/none", "--out", "{}/a"), "does not exist"),
        (("info", "gs://bucket/none.zarr"), "gcsfs"),
        (("batch", "{}/batch.toml", "--out", "s3://bucket/a"), "need a folder on a disk"),
    ],
)
def test_bad_addresses_are_one_line(s3, refused, tmp_path, arguments, said):
    assert said in refused(*(argument.format(tmp_path) for argument in arguments))


SECRET = "opensesame"


@pytest.fixture
def unreached(s3, monkeypatch):
    """Nobody serves the store any more, at an address that holds a password."""
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://me:{SECRET}@127.0.0.1:9")
    monkeypatch.setenv("AWS_MAX_ATTEMPTS", "1")
    forget_sessions()
    yield
    forget_sessions()


@pytest.mark.by_night("info", "convert", "measure")
@pytest.mark.parametrize("verb", ["measure", "info", "convert", "render"])
def test_a_store_that_nobody_serves_is_one_line(unreached, refused, scene, tmp_path, verb):
    """Whoever asks; a box there was called no volume box."""
    boxed = scene(more='\n[[box]]\nfile = "s3://bucket/none.zarr"\n')
    words = {
        "measure": ("s3://bucket/none", "--out", tmp_path / "a"),
        "info": ("s3://bucket/none.zarr",),
        "convert": ("s3://bucket/none.zarr", "--out", tmp_path / "a.nrrd"),
        "render": (boxed, "--out", tmp_path / "a.exr"),
    }
    said = refused(verb, *words[verb])
    assert "cannot be reached" in said and "volume box" not in said and SECRET not in said


def test_a_store_that_is_lost_meanwhile_is_not_damaged(stored, monkeypatch):
    """After the header was read: chunks of our own decoder, and of zarr-python's."""
    box, address = stored
    shutil.rmtree(box / "packed")
    stores._files("s3").rm(f"{address.removeprefix('s3://')}/packed", recursive=True)
    opened = open_arrays(address, ("density",))[1]["density"]

    def lost(*_, **__):
        raise ConnectionError(f"http://me:{SECRET}@127.0.0.1:9 is gone")

    for name in ("info", "cat_file", "cat_ranges"):
        monkeypatch.setattr(stores._files("s3"), name, lost)
    for high in (opened.shape, (1, 1, 1)):
        with pytest.raises(hg.InputError, match=r"cannot be reached: http://…@127\.0\.0\.1:9 is gone"):
            opened.read((0, 0, 0), high)
    with pytest.raises(hg.InputError, match="cannot be reached"):
        hg.load_box(address)


def test_an_address_with_a_password_is_refused_and_not_repeated(refused, scene, tmp_path):
    bad = f"s3://me:{SECRET}@bucket/a.zarr"
    for words in (
        ("info", bad),
        ("measure", bad, "--out", tmp_path / "a"),
        ("simulate", scene(), "--out", bad),
        ("render", scene(more=f'\n[[box]]\nfile = "{bad}"\n'), "--out", tmp_path / "a.exr"),
    ):
        said = refused(*words)
        assert "holds a password" in said and SECRET not in said
    assert stores.address("abfs://box@account/a.zarr") == "abfs://box@account/a.zarr"


STEP = """
[[step]]
name = "nrrd"
verb = "convert"
arguments = ["{}"]
out = "b.nrrd"
"""


@pytest.mark.nightly
def test_a_batch_sees_that_a_box_in_a_store_has_changed(stored, tmp_path):
    """One that the recipe names; one that a scene names is digested alike."""
    _, address = stored
    (tmp_path / "batch.toml").write_text(STEP.format(address))
    for state in ("done", "unchanged", "done"):
        assert [one.state for one in hg.batch(tmp_path / "batch.toml", tmp_path / "out")] == [state]
        if state == "unchanged":
            before = stamp(Path(address))
            stores._files("s3").pipe_file(f"{address.removeprefix('s3://')}/note.txt", b"another")
            assert stamp(Path(address)) != before


@pytest.mark.parametrize("path", ["/data/box.zarr", "box.zarr", "C:/box.zarr", "http://host/box.zarr", "s3", "s3:/"])
def test_paths_are_no_addresses(path):
    assert stores.address(path) is None


@pytest.mark.parametrize("path", ["s3://bucket/a.zarr", "s3:/bucket/a.zarr"])
def test_an_address_that_was_a_path_is_known_again(path):
    assert stores.address(path) == "s3://bucket/a.zarr" and os.fspath(path)
