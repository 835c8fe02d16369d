"""Work on Dask's workers: the bits of one machine, whoever dies; what is not fit for it is refused in one line."""

import dataclasses
import os
import signal
from pathlib import Path

import psutil
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.cluster import cluster as clusters
from hagoromo.cluster.cluster import Cluster, mapped, workers_of
from hagoromo.image import render_tiles, scene_on_worker, walk_tiles
from hagoromo.image.film.film import Turn, film
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.lamp_batches import LAMPS_AT_ONCE
from hagoromo.measurement.normals.smooth_share import Stiffness
from hagoromo.measurement.surface import tile_store
from hagoromo.measurement.surface.tiles import solve_coarse, solve_tiles
from hagoromo.photograph.capture import save_capture
from hagoromo.volume.store import field_blocks
from studies import coverage
from studies.coverage_bench import BENCHES, FULL_WELLS
from studies.near_rig import SURFACE_DISTANCE, Finish, ring_rig, simulate, sphere

SLAB = """
[[box]]
file = "slab.zarr"
position = [-0.1, -0.2, 0.0]
[render]
samples = 2
"""


@pytest.fixture
def slab(scene, box):
    """A scene file with a ball and a volume box."""
    return scene(more=SLAB)


@pytest.fixture
def dense(slab):
    """The same with matter that light of all orders may pass: its extinction follows from its projected area."""
    folder = slab.parent / "slab.zarr"
    dataclasses.replace(hg.load_box(folder), extinction="projected").save(folder, force=True)
    return slab


def bits(image: Image) -> bytes:
    return image.weights.tobytes() + image.alpha.tobytes()


def pids(cluster: Cluster) -> set[int]:
    return set(cluster.client.run(os.getpid).values())


@pytest.mark.nightly
def test_frames_of_a_film_have_the_bits_of_one_machine(slab, address, tmp_path):
    """Rendered by two processes, each of which keeps the scene from one frame to the next."""
    turn = Turn(4, camera=True, lamps=True)
    here = film(slab, tmp_path / "here", turn=turn)
    there = film(slab, tmp_path / "there.gif", turn=turn, scheduler=address)
    assert there.rendered == 4
    for path in here.frames.glob("*.png"):
        assert (there.frames / path.name).read_bytes() == path.read_bytes(), path.name


def test_a_picture_of_tiles_has_the_bits_of_one_machine(slab, address, tmp_path, monkeypatch, capsys):
    """A width and height that no tile divides; two samples a pixel; shadow maps; the files of the command."""
    monkeypatch.setattr(render_tiles, "FEWEST_RAYS", 200)
    one, many = tmp_path / "one.exr", tmp_path / "many.exr"
    assert main(["render", str(slab), "--out", str(one), "--tolerance", "0.02"]) == 0
    assert main(["render", str(slab), "--out", str(many), "--tolerance", "0.02", "--scheduler", address]) == 0
    alone, tiled = hg.read_image(one), hg.read_image(many)
    assert alone.weights.max() > 0 and 0 < alone.alpha.mean() < 1
    assert bits(tiled) == bits(alone) and tiled.metadata == alone.metadata
    assert one.with_suffix(".png").read_bytes() == many.with_suffix(".png").read_bytes()


@pytest.mark.nightly
def test_tiles_under_many_lamps_have_the_bits_of_one_machine(scene, cluster, monkeypatch):
    """Two batches of lamps, which add in one order whichever tile is done first."""
    monkeypatch.setattr(render_tiles, "FEWEST_RAYS", 200)
    lamp = '[[lamp]]\nto_lamp = [0.%d, -1.0, 0.3]\nspectrum = "%s"\n'
    path = scene(more="".join(lamp % (k, "A" if k % 2 else "D65") for k in range(LAMPS_AT_ONCE)))
    _, settings = hg.load_scene(path)
    whole, tiled = hg.render(path), render_tiles.render_tiles(path, settings, cluster)
    assert len(whole.metadata["scene"]["lamps"]) > LAMPS_AT_ONCE and whole.weights.max() > 0
    assert bits(tiled) == bits(whole) and tiled.metadata == whole.metadata and tiled.lamp_names == whole.lamp_names


def test_a_killed_worker_loses_nothing(slab, cluster, monkeypatch):
    """One of two workers is killed when the first of some sixteen tiles has come back."""
    monkeypatch.setattr(render_tiles, "FEWEST_RAYS", 200)
    before, shares = pids(cluster), []

    def kill_at_the_first(share: float, step: str = "") -> None:
        shares.append(share)
        if len(shares) == 2:
            assert 0 < share < 0.2
            os.kill(min(before), signal.SIGKILL)

    _, settings = hg.load_scene(slab)
    tiled = render_tiles.render_tiles(slab, settings, cluster, kill_at_the_first)
    assert shares[-1] == 1.0 and min(before) not in pids(cluster)
    assert bits(tiled) == bits(hg.render(slab))


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("mode", "more"),
    [
        pytest.param("path", {"samples": 3}, marks=pytest.mark.nightly),
        ("path", {"samples": 1, "error": 0.4, "orders": 2}),
        pytest.param("full", {"samples": 1, "walks": 3000}, marks=pytest.mark.nightly),
        pytest.param("march", {"samples": 1}, marks=pytest.mark.nightly),
    ],
)
def test_pictures_of_every_mode_and_layers_have_the_bits_of_one_machine(dense, cluster, monkeypatch, mode, more):
    """Walks until an error, light that is solved on each worker, depth and normals; an area lamp that is seen."""
    for place, name, value in ((render_tiles, "FEWEST_RAYS", 200), (walk_tiles, "PIXELS", (100, 1 << 16))):
        monkeypatch.setattr(place, name, value)
    text = (
        dense.read_text() + "[[area_lamp]]\nposition = [0.0, 0.0, 1.0]\nradius = 0.1\nradiance = 3.0\nvisible = true\n"
    )
    dense.write_text(text)
    settings = dataclasses.replace(hg.load_scene(dense)[1], tolerance=0.1, **more)
    whole = hg.render(dense, settings, mode=mode, layers=True)
    tiled = render_tiles.render_tiles(dense, settings, cluster, mode=mode, layers=True)
    assert bits(tiled) == bits(whole) and whole.weights.max() > 0 and tiled.metadata == whole.metadata
    assert tiled.layers and whole.layers and list(tiled.layers) == list(whole.layers)
    assert all((tiled.layers[name] == layer).all() for name, layer in whole.layers.items())
    assert (tiled.variance is None) == (mode != "path") and (tiled.xyz() == whole.xyz()).all()


SOLVES = """
import os, signal
from pathlib import Path
import hagoromo.image.full.picture as full
plain = full._Unsolved.solved
def solved(self):
    marks = Path({marks!r})
    (marks / str(os.getpid())).touch()
    if {killed} and len(list(marks.iterdir())) == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return plain(self)
full._Unsolved.solved = solved
os.environ["HAGOROMO_CACHE"] = {kept!r}
"""
AS_BEFORE = """
import os
import hagoromo.image.full.picture as full
full._Unsolved.solved = getattr(full._Unsolved.solved, "__globals__", {}).get("plain", full._Unsolved.solved)
os.environ["HAGOROMO_CACHE"] = "off"
"""


@pytest.fixture
def solves(cluster, tmp_path):
    """Workers keep what they solve in a new folder, and leave a mark each; the first of them is killed, if asked."""

    def watched(killed: bool) -> Path:
        marks = tmp_path / "marks"
        marks.mkdir()
        code = SOLVES.format(marks=str(marks), killed=killed, kept=str(tmp_path / "kept"))
        cluster.client.run(exec, code, {})
        return marks

    yield watched
    cluster.client.run(exec, AS_BEFORE, {})


@pytest.mark.nightly
@pytest.mark.parametrize("killed", [False, True])
def test_light_is_solved_by_one_worker_and_taken_over_from_a_killed_one(dense, cluster, monkeypatch, solves, killed):
    """A second picture, from elsewhere, solves nothing."""
    monkeypatch.setattr(render_tiles, "FEWEST_RAYS", 200)
    marks = solves(killed)
    settings = dataclasses.replace(hg.load_scene(dense)[1], tolerance=0.1, walks=0)
    tiled = render_tiles.render_tiles(dense, settings, cluster, mode="full")
    assert len(list(marks.iterdir())) == 1 + killed
    assert bits(tiled) == bits(hg.render(dense, settings, mode="full")) and tiled.weights.max() > 0
    dense.write_text(dense.read_text().replace("eye = [0.0", "eye = [0.1", 1))
    turned = render_tiles.render_tiles(dense, settings, cluster, mode="full")
    assert bits(turned) == bits(hg.render(dense, settings, mode="full")) != bits(tiled)
    assert len(list(marks.iterdir())) == 1 + killed


def test_an_interrupted_picture_of_walks_goes_on_from_here_and_there(dense, cluster, monkeypatch):
    """What workers had done when the client was interrupted is kept; another run ends with the bits of one machine."""
    monkeypatch.setattr(walk_tiles, "PIXELS", (100, 1 << 16))
    settings = dataclasses.replace(hg.load_scene(dense)[1], samples=4)
    shares = []

    def interrupt_the_third(share: float, step: str = "") -> None:
        shares.append(share)
        if len(shares) == 4:
            raise KeyboardInterrupt

    with pytest.raises(hg.RenderInterrupted) as interrupt:
        render_tiles.render_tiles(dense, settings, cluster, interrupt_the_third, mode="path")
    unfinished = interrupt.value.image
    assert 0.0 < unfinished.metadata["walks"] < 4.0
    for image in (
        hg.render(dense, settings, mode="path", unfinished=unfinished),
        render_tiles.render_tiles(dense, settings, cluster, mode="path", unfinished=unfinished),
    ):
        assert bits(image) == bits(hg.render(dense, settings, mode="path"))


BATCH = """
each = "scenes/*.toml"
[[step]]
name = "rendered"
verb = "render"
arguments = ["{path}"]
out = "pictures/{name}.exr"
[[step]]
name = "dimmed"
verb = "expose"
arguments = ["{rendered}"]
out = "dimmed/{name}.exr"
"""


@pytest.mark.nightly
def test_a_batch_goes_on_when_a_worker_is_killed(scene, cluster, address, tmp_path):
    """One of two workers is killed when the first of ten steps is done; one step fails, and only that."""
    (tmp_path / "scenes").mkdir()
    for number in range(5):
        text = scene("size = [61, 47]", f"size = [{20 + number}, 17]").read_text()
        text = text.replace("gamma = 0.2", "gamma = -0.2") if number == 3 else text
        (tmp_path / "scenes" / f"{number}.toml").write_text(text)
    (tmp_path / "batch.toml").write_text(BATCH)
    before, shares = pids(cluster), []

    def kill_at_the_first(share: float, step: str = "") -> None:
        shares.append(share)
        if len(shares) == 2:
            os.kill(max(before), signal.SIGKILL)

    many = hg.batch(tmp_path / "batch.toml", tmp_path / "many", scheduler=address, progress=kill_at_the_first)
    assert 0 < shares[1] <= 0.2 and max(before) not in pids(cluster)
    alone = hg.batch(tmp_path / "batch.toml", tmp_path / "one")
    assert [(one.step, one.state) for one in many] == [(one.step, one.state) for one in alone]
    assert [one.step for one in many if one.state != "done"] == ["rendered 3", "dimmed 3"]
    for tiled, whole in zip(many, alone, strict=True):
        assert tiled.state != "done" or tiled.out.read_bytes() == whole.out.read_bytes()


@pytest.mark.nightly
def test_a_study_has_the_bits_of_one_machine(address, tmp_path, monkeypatch):
    """Simulations with seeds of their own."""
    monkeypatch.setattr(coverage, "BENCHES", {"three lamps": BENCHES["three lamps"]})
    monkeypatch.setattr(coverage, "FULL_WELLS", {level: FULL_WELLS[level] for level in list(FULL_WELLS)[1:2]})
    names = []
    coverage.coverage_study(tmp_path / "one", simulations=5)
    coverage.coverage_study(
        tmp_path / "many", simulations=5, scheduler=address, progress=lambda _, name="": names.append(name)
    )
    assert names == [f"three lamps, {level}" for level in coverage.FULL_WELLS for _ in range(5)] + [""]
    one, many = ((tmp_path / folder / "results.json").read_bytes() for folder in ("one", "many"))
    assert many == one


def test_results_of_tasks_keep_their_order(address):
    """Whichever is done first: a task that takes longer stands first."""
    tasks = [(0.3 / (1 + number),) for number in range(7)]
    assert mapped(slept, tasks, address) == mapped(slept, tasks) == [seconds for (seconds,) in tasks]


def slept(seconds: float) -> float:
    """Sent to workers as it is, since they do not find the tests."""
    import time

    time.sleep(seconds)
    return seconds


BALL = """
kind = "solid"
voxel_mm = 0.1
shape = {form = "sphere", radius_mm = 3.0}
material = {alpha = 0.2, beta = 0.1, gamma = 0.2, n = 1.5, body_colour = 0.8}
"""


def test_a_box_of_parts_has_the_bytes_of_one_machine(cluster, address, tmp_path, monkeypatch):
    """Of a ball in six parts every file of the box is the same."""
    few = "setattr(__import__('hagoromo.volume.store.field_blocks', fromlist=['it']), 'BRICKS_AT_ONCE', {})"
    cluster.client.run(eval, few.format(64))
    monkeypatch.setattr(field_blocks, "BRICKS_AT_ONCE", 64)
    (tmp_path / "ball.toml").write_text(BALL)
    try:
        parts = []
        tell = lambda share, step="": parts.append(share)  # noqa: E731
        hg.build_to(tmp_path / "ball.toml", tmp_path / "many.zarr", progress=tell, scheduler=address)
    finally:
        cluster.client.run(eval, few.format(1 << 12))
    hg.build_to(tmp_path / "ball.toml", tmp_path / "one.zarr")
    one, many = (
        {file.relative_to(box).as_posix(): file.read_bytes() for file in sorted(box.rglob("*")) if file.is_file()}
        for box in (tmp_path / "one.zarr", tmp_path / "many.zarr")
    )
    assert len(parts) > 6 and len(one) > 20 and one == many


@pytest.mark.nightly
def test_tiles_of_a_measurement_have_the_bits_of_one_machine(cluster, tmp_path, monkeypatch):
    """A picture of two tiles, with everything that they share, and normals that are smoothed over both; the scratch
    folder is left empty.
    """
    monkeypatch.setattr(tile_store, "COARSE_PIXELS", 200)
    capture, _ = simulate(ring_rig(280, 60, 8), sphere, Finish(0.3), bits=10)
    save_capture(capture, tmp_path / "capture")
    source = tile_store.FolderSource(tmp_path / "capture", tuple(range(8)))
    with tile_store.tile_store(source, tmp_path) as store:
        coarse = dataclasses.replace(solve_coarse(store, 1.03 * SURFACE_DISTANCE), stiffness=Stiffness(1e5, 0.5))
        one, many = solve_tiles(store, coarse), solve_tiles(store, coarse, workers=cluster)
        assert store.count == 2
    assert one.converged[:, 192:].any() and one.converged[:, :192].any()
    assert one.stiffness == many.stiffness
    assert one.summed is not None
    assert (one.summed < float("inf")).sum() > 1000
    for field in dataclasses.fields(one):
        if field.name != "stiffness":
            assert getattr(one, field.name).tobytes() == getattr(many, field.name).tobytes(), field.name
    assert [path.name for path in tmp_path.iterdir()] == ["capture"]


def test_a_capture_that_is_solved_as_one_says_so(scene, capture, address, tmp_path):
    with pytest.warns(UserWarning, match="the capture is measured here"):
        hg.measure(capture, scheduler=address)


def test_a_worker_that_finds_another_file_refuses(slab, cluster, monkeypatch):
    monkeypatch.setattr(scene_on_worker, "content_with_named", lambda *_, **__: "of another file")
    _, settings = hg.load_scene(slab)
    with pytest.raises(hg.InputError, match=r"scene\.toml, or a file that it names, is another one on a worker"):
        render_tiles.render_tiles(slab, settings, cluster)


def test_bad_input_of_a_worker_is_one_line(scene, address, refused, tmp_path):
    said = refused("render", scene("scale = 0.15", "scale = 0.0"), "--out", tmp_path / "a.exr", "--scheduler", address)
    assert said.count("\n") == 1 and "scene.toml" in said


@pytest.mark.parametrize("text", ["0", "-1", "two", "1e3", "999999999999", "٣", ""])
def test_what_is_no_scheduler_is_one_line(scene, refused, tmp_path, text):
    said = refused("render", scene(), "--out", tmp_path / "a.exr", f"--scheduler={text}")
    assert "give a number of workers from 1 to 256, local, or the address of one that runs: tls://host:8786" in said


def test_workers_of_another_version_are_refused(scene, cluster, address, refused, tmp_path):
    """At once where they are there already; by the task itself where they came later."""
    of_worker = "setattr(__import__('hagoromo.cluster.cluster').cluster.cluster, '__version__', {0!r}) or setattr("
    of_worker += "__import__('hagoromo.version').version, '__version__', {0!r})"
    cluster.client.run(eval, of_worker.format("0.0.1"))
    try:
        said = refused("render", scene(), "--out", tmp_path / "a.exr", "--scheduler", address)
        assert f"has hagoromo 0.0.1, the client {hg.__version__}: install {hg.__version__} on all workers" in said
        with pytest.raises(hg.InputError, match=r"a worker has hagoromo 0\.0\.1"):
            cluster.run(os.getpid)
    finally:
        cluster.client.run(eval, of_worker.format(hg.__version__))
    assert cluster.run(os.getpid) in pids(cluster)


def test_without_dask_the_extra_is_named(scene, refused, tmp_path, monkeypatch):
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    assert "install hagoromo[cluster]" in refused("render", scene(), "--out", tmp_path / "a.exr", "--scheduler", "2")


def test_many_tasks_wait_here_and_not_at_the_scheduler(cluster):
    """10,000 tasks are sent as others are done: some four a worker are under way at any time."""
    sent = 0

    def tasks():
        nonlocal sent
        for number in range(10_000):
            sent += 1
            yield (number,)

    for done, (number, result) in enumerate(cluster.results(abs, tasks())):
        assert result == number and sent - done <= 2 * clusters.AHEAD
        if done == 50:
            break


def test_two_clusters_of_one_machine_stand_side_by_side_on_loopback(cluster):
    """Nothing listens to other machines, where whoever reaches a worker may run what he likes on it."""
    with workers_of(1) as other:
        assert (cluster.run(abs, -1), other.run(abs, -2)) == (1, 2)
        here = psutil.Process()
        sockets = [one for process in (here, *here.children(recursive=True)) for one in process.net_connections()]
    listening = {one.laddr.ip for one in sockets if one.status == psutil.CONN_LISTEN}
    assert listening == {"127.0.0.1"}


@pytest.mark.nightly
def test_a_task_of_which_workers_die_is_one_line_and_the_next_one_runs(cluster, monkeypatch):
    monkeypatch.setattr(cluster.client.cluster.scheduler, "allowed_failures", 0)
    with pytest.raises(
        hg.InputError, match=r"workers died of one task, 1 in all, the last at tls://127\.0\.0\.1:.*memory"
    ):
        cluster.run(eval, "__import__('os').kill(__import__('os').getpid(), 9)")
    assert cluster.run(abs, -3) == 3
