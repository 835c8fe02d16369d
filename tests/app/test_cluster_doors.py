"""Doors of a cluster: no other user gets into workers of this machine, and nobody is asked who is not trusted."""

import asyncio
import json
import os
import re
import shutil
import socket
import subprocess
import sys
import threading
import urllib.error
import urllib.request
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import distributed
import pytest
import yaml
from dask import config
from distributed.comm.core import listen
from distributed.protocol.serialize import ToPickle

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.cluster import connection
from hagoromo.cluster.cluster import workers_of
from hagoromo.cluster.connection import scheduler_address
from hagoromo.files import stores

PAGE = (Path(__file__).parents[2] / "docs" / "cluster.md").read_text(encoding="utf-8")
SECRET = "opensesame"
LocalCluster: Any = distributed.LocalCluster
ATTACK = """
import asyncio, json, os, sys
from distributed import Security
from distributed.comm import connect
from distributed.protocol.pickle import dumps
doors = json.loads(sys.argv[1])
if os.getuid() == 0:  # another user from here on
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
program = {"op": "run", "function": dumps(os.getpid), "args": dumps(()), "kwargs": dumps({}), "reply": True}
async def result(address, security, message):
    comm = await connect(address, timeout=2, **security.get_connection_args("client"))
    try:
        await comm.write(message)
        return str(await comm.read())
    finally:
        comm.abort()
async def main():
    found = {}
    for name, (door, runs) in doors.items():
        for scheme, security in (("tcp", Security()), ("tls", Security.temporary()))[: 1 + name.startswith("ours")]:
            message = program if runs else {"op": "identity", "reply": True}
            try:
                at = f"{scheme}://{door}"
                found[f"{name} by {scheme}"] = await asyncio.wait_for(result(at, security, message), 5)
            except Exception:
                found[f"{name} by {scheme}"] = None
    print(json.dumps({"user": os.getuid(), "found": found}))
asyncio.run(main())
"""


def doors_of(cluster: Any) -> dict[str, tuple[str, bool]]:
    """Name → host and port of the scheduler, of a worker and its nanny, and whether it runs a program it is sent."""
    worker = next(iter(cluster.workers.values()))
    places = {"scheduler": cluster.scheduler.address, "worker": worker.worker_address, "nanny": worker.address}
    return {name: (place.partition("://")[2], name != "scheduler") for name, place in places.items()}


@pytest.fixture(scope="module")
def ours():
    """A worker process of this machine."""
    with workers_of(1) as cluster:
        yield cluster


def test_no_other_user_of_the_machine_runs_a_program_in_a_local_cluster(ours):
    """The same attack, by another user where this runs as root, gets into a cluster that Dask starts by itself."""
    with LocalCluster(
        n_workers=1, threads_per_worker=1, dashboard_address=None, worker_dashboard_address=None
    ) as open_to_all:
        doors = {f"ours: {name}": door for name, door in doors_of(ours.client.cluster).items()}
        doors |= {f"open: {name}": door for name, door in doors_of(open_to_all).items()}
        said = subprocess.run([sys.executable, "-c", ATTACK, json.dumps(doors)], capture_output=True, check=True)
        assert ours.run(abs, -1) == 1
    attack = json.loads(said.stdout)
    assert attack["user"] == (65534 if os.getuid() == 0 else os.getuid())
    entered = {name for name, found in attack["found"].items() if found}
    assert entered == {"open: scheduler by tcp", "open: worker by tcp", "open: nanny by tcp"}
    assert "'result': " in attack["found"]["open: worker by tcp"]


def test_workers_of_this_machine_serve_no_page(ours):
    known = ours.client.scheduler_info(n_workers=-1)
    services = [facts.get("services", {}) for facts in (known, *known["workers"].values())]
    ports = {port for each in services for port in each.values()}
    for port in ports:
        for page in ("", "health", "metrics", "json/counts.json", "info/main/workers.html", "sysmon", "statics"):
            with pytest.raises(urllib.error.HTTPError, match="404"):
                urllib.request.urlopen(f"http://127.0.0.1:{port}/{page}", timeout=5)
    assert len(ports) == 2


class Program:
    """What makes a folder when it is unpickled."""

    def __init__(self, mark: Path) -> None:
        self.mark = mark

    def __reduce__(self):
        return os.mkdir, (str(self.mark),)


@pytest.fixture(scope="module")
def attacking(tmp_path_factory):
    """The port of a scheduler that sends whoever connects a program, the folder that it makes, and who connected."""
    mark, who = tmp_path_factory.mktemp("attacker") / "ran", []
    ready, end = threading.Event(), threading.Event()
    port = 0

    async def answer(comm):
        who.append(comm.peer_address)
        with_it = [{"op": "stream-start", "x": ToPickle(Program(mark))}]
        try:
            await comm.read()
            await comm.write(with_it)
        except OSError:
            pass

    async def serve():
        nonlocal port
        serving: Any = listen("tcp://127.0.0.1:0", answer, deserialize=False)
        listener = await serving
        port = int(listener.listen_address.rpartition(":")[2])
        ready.set()
        while not end.is_set():
            await asyncio.sleep(0.02)
        listener.stop()

    thread = threading.Thread(target=asyncio.run, args=(serve(),))
    thread.start()
    ready.wait(20)
    yield port, mark, who
    end.set()
    thread.join()


@pytest.fixture
def attacker(attacking):
    """As long as nobody has connected."""
    port, mark, who = attacking
    who.clear()
    shutil.rmtree(mark, ignore_errors=True)
    return port, mark, who


def test_a_scheduler_that_nobody_vouches_for_is_not_even_asked(attacker, scene, refused, tmp_path, monkeypatch):
    """Trusted, it runs its program here: that is what the trust is about."""
    port, mark, who = attacker
    monkeypatch.setattr(connection, "CONNECT_S", 1.0)
    words = ("render", scene(), "--out", tmp_path / "a.exr")
    assert "add --trust-scheduler" in refused(*words, "--scheduler", f"tcp://127.0.0.1:{port}")
    assert "needs certificates" in refused(*words, "--scheduler", f"tls://127.0.0.1:{port}")
    with pytest.raises(hg.InputError, match="can run programs on this machine"):
        hg.render(tmp_path / "scene.toml", scheduler=f"tcp://127.0.0.1:{port}")
    assert not who and not mark.exists()
    with pytest.raises(hg.InputError, match="no Dask scheduler answers"):
        hg.render(tmp_path / "scene.toml", scheduler=hg.TrustedScheduler(f"tcp://127.0.0.1:{port}"))
    assert who and mark.is_dir()


RECIPE = """
[[step]]
name = "a"
verb = "{}"
arguments = {}
out = "a{}"
"""


FORMS = (
    ["--scheduler={}"], ["--scheduler", "{}"], ["--trust-scheduler", "--scheduler={}"], ["--schedul={}"],
    ["-scheduler", "{}"], ["--scheduler", "1"], ["--trust-scheduler"], ["--samples", "1", "--scheduler={}"],
)  # fmt: skip


@pytest.mark.parametrize("verb", ["render", "build", "measure"])
def test_no_recipe_reaches_a_scheduler(attacker, refused, tmp_path, verb):
    """By every verb that has one: nobody is asked, no worker is started, nothing is made."""
    port, mark, who = attacker
    recipe = tmp_path / "batch.toml"
    for words in FORMS if verb == "render" else FORMS[:3]:
        given = ["a.toml", *(word.format(f"tcp://127.0.0.1:{port}") for word in words)]
        recipe.write_text(RECIPE.format(verb, json.dumps(given), ".exr" if verb == "render" else ""))
        said = refused("batch", recipe, "--out", tmp_path / "out")
        assert "it has --scheduler" in said or "Unrecognized" in said
    assert not who and not mark.exists()


@pytest.mark.parametrize(
    "address",
    [
        "http://127.0.0.1:9", "https://h:9", "inproc://127.0.0.1/1/2", "ws://127.0.0.1:9", "ucx://127.0.0.1:9",
        "file:///etc/passwd", "nonsense://127.0.0.1:9", "TCP://127.0.0.1:9", "tcp://", "tcp://h", "tcp://127.0.0.1:x",
        "tcp://127.0.0.1:0", "tcp://127.0.0.1:99999", "tcp://[::1", "tcp://h:1/path", "tcp://h:1,tcp://h:2",
        f"tcp://me:{SECRET}@127.0.0.1:9", f"tls://{SECRET}@127.0.0.1:9", f"tls://h:9?token={SECRET}", f"tls://h:9#{SECRET}",
        f"http://me:{SECRET}@h:9/",
    ],
)  # fmt: skip
def test_another_form_of_address_is_one_line_and_no_password_is_in_it(scene, refused, tmp_path, address):
    words = ("render", scene(), "--out", tmp_path / "a.exr", "--scheduler", address)
    said = refused(*words, "--trust-scheduler")
    assert "give tls://host:8786, or tcp://host:8786 with --trust-scheduler" in said and SECRET not in said


@pytest.mark.parametrize("words", [["--schedulr"], ["--seed"], ["--mode"], ["--scheduler", "1", "x"], []])
def test_wrong_use_does_not_repeat_a_password(refused, words):
    """Also where the message breaks it over two rows of a box."""
    addresses = f"tcp://me:{SECRET}@host:8786", f"me:{SECRET}@{'h' * 90}:8786", f"s3://me:{SECRET}@b/c"
    assert SECRET not in refused("render", "a.toml", "--out", "a.exr", *words, *addresses).replace(" ", "")


def test_a_dead_address_is_one_line(scene, refused, tmp_path, monkeypatch):
    monkeypatch.setattr(connection, "CONNECT_S", 0.3)
    words = ("render", scene(), "--out", tmp_path / "a.exr", "--trust-scheduler")
    for address in ("tcp://127.0.0.1:9", "tcp://[::1]:9", "tcp://no-such-host.invalid:9"):
        assert f"no Dask scheduler answers at {address} within 0.3 s" in refused(*words, "--scheduler", address)


@contextmanager
def speaking(answer: bytes):
    """The port of a server that says the same to all who connect."""
    with socket.create_server(("127.0.0.1", 0)) as server, ExitStack() as taken:

        def serve():
            with suppress(OSError):
                while True:
                    taken.enter_context(server.accept()[0]).sendall(answer)

        thread = threading.Thread(target=serve)
        thread.start()
        yield server.getsockname()[1]
        server.shutdown(socket.SHUT_RDWR)
        thread.join()


def test_what_is_no_scheduler_is_one_line(scene, refused, tmp_path, monkeypatch):
    """It takes connections and says something else, or nothing."""
    monkeypatch.setattr(connection, "CONNECT_S", 0.5)
    words = ("render", scene(), "--out", tmp_path / "a.exr", "--trust-scheduler", "--scheduler")
    for answer in (b"HTTP/1.1 400 Bad Request\r\n\r\n", b"", b"\xff" * 64):
        with speaking(answer) as port:
            said = refused(*words, f"tcp://127.0.0.1:{port}")
        assert "no Dask scheduler answers" in said


def test_trust_without_an_address_is_one_line(scene, refused, tmp_path):
    for words in (["--trust-scheduler"], ["--trust-scheduler", "--scheduler", "2"]):
        said = refused("render", scene(), "--out", tmp_path / "a.exr", *words)
        assert "--trust-scheduler is for an address" in said


def test_workers_that_are_killed_when_they_start_are_one_line(scene, refused, tmp_path):
    (tmp_path / "kill.py").write_text("import os\nos.kill(os.getpid(), 9)\n")
    with config.set({"distributed.worker.preload": [str(tmp_path / "kill.py")]}):
        said = refused("render", scene(), "--out", tmp_path / "a.exr", "--scheduler", "1")
    assert "1 worker processes did not start: Nanny failed to start worker process; one was killed" in said


@contextmanager
def documented(home: Path):
    """Certificates as the page says how to make them, in the folder `home`, and Dask's settings as it has them."""
    (commands,) = re.findall(r"```sh\n(.*?)```", PAGE, re.DOTALL)
    subprocess.run(["sh", "-ec", commands], env=os.environ | {"HOME": str(home)}, check=True, capture_output=True)
    (settings,) = re.findall(r"```yaml\n(distributed:.*?)```", PAGE, re.DOTALL)
    stated = yaml.safe_load(settings.replace("/home/me", str(home)))
    with config.set(config.merge(config.config, stated)):  # as Dask merges the files of its settings
        yield


@pytest.mark.skipif(shutil.which("openssl") is None, reason="no openssl")
def test_certificates_that_are_made_as_documented_let_their_owner_in_and_nobody_else(tmp_path, monkeypatch):
    monkeypatch.setattr(connection, "CONNECT_S", 3.0)
    monkeypatch.setattr(stores, "kept", stores.Kept())  # of the worker, a thread of this process
    with documented(tmp_path / "mine"):
        assert (tmp_path / "mine" / ".config" / "dask" / "tls" / "key.pem").stat().st_mode & 0o077 == 0
        with LocalCluster(
            n_workers=1, threads_per_worker=1, processes=False, protocol="tls://", dashboard_address=None,
            worker_dashboard_address=None, host="127.0.0.1",
        ) as cluster:  # fmt: skip
            address = cluster.scheduler_address
            assert address.startswith("tls://")
            with workers_of(address) as mine:
                assert mine.run(abs, -3) == 3
            with documented(tmp_path / "other"):
                with pytest.raises(hg.InputError, match="do not belong together"), workers_of(address):
                    pass
            with config.set({"distributed.comm.tls.ca-file": str(tmp_path / "none.pem")}):
                with pytest.raises(hg.InputError, match=r"cannot be read: .*No such file"), workers_of(address):
                    pass


def test_addresses_are_read():
    assert scheduler_address("tls://[fe80::1%eth0]:8786/")[:] == ("tls://[fe80::1%eth0]:8786", "fe80::1%eth0", 8786)
    assert scheduler_address(hg.TrustedScheduler("tcp://node-1.example.org:1"))[1:] == ("node-1.example.org", 1)


def test_a_password_is_in_no_message_of_any_kind(capsys, tmp_path, scene):
    """Errors, warnings, results and progress pass one place."""
    with pytest.warns(UserWarning):
        import warnings

        warnings.warn(f"tcp://me:{SECRET}@host:1", stacklevel=1)
    assert str(hg.InputError(f"at tcp://me:{SECRET}@host:1, and s3:/me:{SECRET}@b")) == "at tcp://…@host:1, and s3:/…@b"
    assert main(["render", str(scene()), "--out", str(tmp_path / "a.exr"), "--scheduler", f"tcp://a:{SECRET}@h:1"]) == 2
    assert SECRET not in "".join(capsys.readouterr())
