"""The server of the page against those whom it is not for, and against too much of everything."""

import asyncio
import json
import os
import signal
import socket
import stat
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from http.client import HTTPConnection
from pathlib import Path
from threading import Thread

import pytest
from served import FORM, MOST, PATIENCE, Client, served, wait_for

from rotorfit.app.pages import MOST_PAGES, MOST_WAITING, Job, Pages
from rotorfit.app.server import MOST_CONNECTIONS
from rotorfit.errors import OutputError


def kept(server) -> list[str]:
    """Return every file that the server holds."""
    # Not rglob: it fails over a folder that the server removes meanwhile.
    return sorted(name for _, _, names in os.walk(server.pages.folder) for name in names)


def test_the_folder_is_nobody_elses(server):
    assert stat.S_IMODE(server.pages.folder.stat().st_mode) == 0o700
    assert server.address.startswith("http://127.0.0.1:")
    assert server.sockets[0].getsockname()[0] == "127.0.0.1"


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"host": "evil.example"}, "127.0.0.1 and localhost only"),
        ({"host": "127.0.0.1"}, "127.0.0.1 and localhost only"),
        ({"host": None}, "127.0.0.1 and localhost only"),
        ({"origin": "http://evil.example"}, "another site's page"),
        ({"origin": "null"}, "another site's page"),
        ({"origin": None}, "another site's page"),
        ({"token": "x" * 43}, "use the whole address"),
        ({"token": ""}, "use the whole address"),
        ({"token": "%C3%A9"}, "use the whole address"),
        ({"method": "DELETE"}, "GET and POST only"),
        ({"method": "OPTIONS"}, "GET and POST only"),
    ],
)
def test_others_are_refused_in_one_line(server, change, words):
    client = Client(server.address)
    path = client.path("open")
    if "token" in change:
        path = f"/{change.pop('token')}/open"
    method = change.pop("method", "POST")
    # A request without Host is none: what it brings is not read, and its connection may be reset.
    brought = None if change.get("host", "") is None else b"{}"
    status, body, headers = client.send(method, path, brought, **change)
    assert status in (400, 403)
    if status == 403:
        assert words in body.decode()
        assert body.count(b"\n") == 1
        assert headers["cache-control"] == "no-store"
        assert headers["x-content-type-options"] == "nosniff"
        assert "access-control-allow-origin" not in headers


def test_the_page_may_speak_to_itself_alone(server):
    client = Client(server.address)
    status, _, headers = client.send(
        "GET", client.path("engine.json"), host=f"localhost:{client.host[10:]}"
    )
    assert status == 200
    policy = headers["content-security-policy"]
    assert policy.startswith("default-src 'none'; script-src 'self'; style-src 'self'")
    assert "unsafe" not in policy and "http" not in policy
    assert headers["referrer-policy"] == "no-referrer"
    assert headers["cross-origin-resource-policy"] == "same-origin"


@pytest.mark.parametrize(
    "path",
    ["../engine.py", "..%2Fengine.py", "%2e%2e/%2e%2e/pyproject.toml", "a%00", "/etc/passwd"],
)
def test_no_path_leads_out(server, page, path):
    for address in (path, f"page/{page.page}/document/{path}", f"page/{path}/present"):
        status, body, _ = page.send("GET", page.path(address))
        assert status == 404
        assert b"import" not in body and b"root:" not in body


def test_a_log_is_dropped_identified_and_shown(server, page, flight):
    stated = page.drop("../../flight.csv", flight)
    assert (stated["name"], stated["kind"]) == ("flight.csv", "log")
    outcome = page.call("identify", {"form": FORM})
    kt = next(p["value"] for p in outcome["result"]["parameters"] if p["name"] == "kt")
    assert kt > 0
    status, report, headers = page.send("GET", page.path(f"page/{page.page}/document/report"))
    assert (status, headers["content-type"]) == (200, "text/html; charset=utf-8")
    assert b"flight.csv" in report
    assert "sandbox allow-scripts" in headers["content-security-policy"]
    assert "connect-src" not in headers["content-security-policy"]
    again = page.call("restore")
    assert again["outcome"]["result"] == outcome["result"]
    assert again["running"] is False
    # Another page has nothing of it.
    assert page.opened().call("restore") == {
        "files": [], "form": None, "outcome": None, "running": False
    }  # fmt: skip


def endless():
    while True:
        yield bytes(65536)


@pytest.mark.parametrize("sent", ["announced", "endless"])
def test_more_than_a_page_may_hold_is_refused(server, page, sent):
    before = kept(server)
    if sent == "announced":
        path = page.path(f"page/{page.page}/add_file?name=a.bin")
        _, body, _ = page.send("POST", path, b"x", content_length=str(MOST + 1))
        refused = json.loads(body)["refused"]
    else:
        refused = received(page, endless())
    assert refused is None or "may hold 20 MB" in refused
    assert kept(server) == before
    assert page.call("restore")["files"] == []
    assert "version" in page.call("options")


def received(page: Client, pieces) -> str | None:
    """Send until the server has enough; None where it hung up before its words came through."""
    try:
        return page.drop("a.bin", pieces)["refused"]
    except (ConnectionResetError, BrokenPipeError):
        return None


def test_a_sender_who_goes_leaves_nothing(server, page):
    before = kept(server)
    connection = HTTPConnection(page.host)
    connection.putrequest(
        "POST", page.path(f"page/{page.page}/add_file?name=a.bin"), skip_host=True
    )
    for name, value in (("host", page.host), ("origin", f"http://{page.host}")):
        connection.putheader(name, value)
    connection.putheader("content-length", "1000000")
    connection.endheaders()
    connection.send(bytes(100))
    wait_for(lambda: len(kept(server)) > len(before))
    connection.close()
    wait_for(lambda: len(kept(server)) <= len(before))
    assert kept(server) == before


@pytest.mark.parametrize(
    ("body", "words"),
    [
        (b"{", "not JSON"),
        (b"[]", "not a table"),
        (b"[" * 100_000, "not JSON"),
        (b'{"form": NaN}', "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b" " * 1_000_001, "the form is too long"),
    ],
)
def test_calls_that_are_none(page, body, words):
    status, said, _ = page.send("POST", page.path(f"page/{page.page}/describe"), body)
    assert status == 400
    assert words in json.loads(said)["refused"]
    assert b"\n" not in said


def test_no_call_but_the_known_ones(page):
    for name in ("__class__", "clear", "receive", "document"):
        assert page.call(name) == {"refused": f"no call {name!r}"}
    assert Client(page.address, "0" * 22).call("options")["refused"].startswith("this page was")


def test_a_flood_is_bounded_and_survived(server, page):
    def ask(_) -> int:
        return page.send("POST", page.path(f"page/{page.page}/options"), b"{}")[0]

    with ThreadPoolExecutor(2 * MOST_CONNECTIONS) as many:
        said = list(many.map(ask, range(3 * MOST_CONNECTIONS)))
    assert set(said) <= {200, 503}
    assert 200 in said
    assert "version" in page.call("options")


def test_there_is_an_end_to_pages(server, assert_text):
    opened = [Client(server.address).opened() for _ in range(MOST_PAGES)]
    looking = [
        socket.create_connection(("127.0.0.1", server.sockets[0].getsockname()[1])) for _ in opened
    ]
    try:
        for client, connection in zip(opened, looking, strict=True):
            path = client.path(f"page/{client.page}/present")
            connection.sendall(f"GET {path} HTTP/1.1\r\nHost: {client.host}\r\n\r\n".encode())
            assert connection.recv(100)
        client = Client(server.address)
        status, body, _ = client.send("POST", client.path("open"), b"{}")
        refused = json.loads(body)
        assert (status, [*refused]) == (429, ["refused"])
        assert_text(refused["refused"])
    finally:
        for connection in looking:
            connection.close()
    # Those that nobody looks at any more make room.
    wait_for(lambda: client.send("POST", client.path("open"), b"{}")[0] == 200)


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds the process in /proc")
def test_a_process_that_dies_leaves_the_page_alive(server, page, assert_wording):
    def children() -> set[int]:
        tasks = Path("/proc/self/task").glob("*/children")
        return {int(pid) for task in tasks for pid in task.read_text().split()}

    before = children()
    said: list[dict] = []
    calling = Thread(target=lambda: said.append(page.call("example")))
    calling.start()
    wait_for(lambda: children() - before)
    for pid in children() - before:
        os.kill(pid, signal.SIGKILL)
    calling.join(PATIENCE)
    assert "status -9" in said[0]["refused"]
    assert_wording(said[0]["refused"])
    assert "version" in page.call("options")


def test_work_is_stopped(server, page):
    said: list[dict] = []
    calling = Thread(target=lambda: said.append(page.call("example")))
    calling.start()
    wait_for(lambda: server.pages.get(page.page).jobs)
    assert page.call("stop") == {}
    calling.join(PATIENCE)
    assert said == [{"refused": "stopped", "stopped": True}]
    assert page.call("follow")["stopped"] is True


def test_long_calls_take_turns():
    at_work: list[tuple[Path, str]] = []
    most_of_all, most_of_one = 0, 0

    async def work(engine, job: Job):
        nonlocal most_of_all, most_of_one
        own = engine.folder, job.name
        at_work.append(own)
        most_of_all = max(most_of_all, len(at_work))
        most_of_one = max(most_of_one, at_work.count(own))
        await asyncio.sleep(0)
        at_work.remove(own)
        return {"done": job.argument["number"]}

    async def run():
        every = Pages(most_bytes=1, work=work)
        open_pages = [every.open(None) for _ in range(3)]
        assert all(page is not None for page in open_pages)
        names = [*["identify"] * 10, *["look"] * 10]
        jobs = [
            [every.begin(page, name, {"number": i}) for i, name in enumerate(names)]
            for page in open_pages
        ]
        last = [[event async for event in job.events()][-1]["answer"] for job in jobs[0]]
        for page_jobs in jobs:
            for job in page_jobs:
                async for _ in job.events():
                    pass
        await every.end()
        assert not every.folder.exists()
        return last

    last = asyncio.run(run())
    assert last[:MOST_WAITING] == [{"done": i} for i in range(MOST_WAITING)]
    assert all("try later" in one["refused"] for one in last[MOST_WAITING:])
    # Of one page one identification and one look, of all pages two.
    assert (most_of_one, most_of_all) == (1, 2)
    assert len(last) == 20


def test_a_page_that_is_closed_is_forgotten(assert_text):
    with served() as own:
        page = Client(own.address).opened()
        port = own.sockets[0].getsockname()[1]
        with socket.create_connection(("127.0.0.1", port)) as presence:
            path = page.path(f"page/{page.page}/present")
            presence.sendall(f"GET {path} HTTP/1.1\r\nHost: {page.host}\r\n\r\n".encode())
            assert presence.recv(100)
            name = page.drop("nothing.csv", b"")["name"]
            assert page.call("restore")["files"][0]["name"] == name
            assert kept(own)
            own.pages.grace = 0.0  # not earlier: getting here may take long
        wait_for(lambda: not kept(own))
        assert_text(page.call("restore")["refused"])
        folder = own.pages.folder
    assert not folder.exists()


@pytest.mark.skipif(sys.platform == "win32", reason="signals of POSIX")
@pytest.mark.parametrize(
    "ending", [signal.SIGTERM, pytest.param(signal.SIGHUP, marks=pytest.mark.slow)]
)
def test_a_signal_ends_it_and_nothing_is_left(tmp_path, ending):
    command = [sys.executable, "-m", "rotorfit", "app", "--no-browser"]
    environment = {**os.environ, "TMPDIR": str(tmp_path)}
    pipe = subprocess.PIPE
    with subprocess.Popen(command, env=environment, stdout=pipe, stderr=pipe, text=True) as process:
        assert process.stdout is not None
        page = Client(process.stdout.readline().strip()).opened()
        calling = Thread(target=page.call, args=("example",))
        calling.start()  # a process is at work
        wait_for(lambda: list(tmp_path.glob("rotorfit-app-*/*")))
        process.send_signal(ending)
        _, said = process.communicate(timeout=PATIENCE)
        calling.join(PATIENCE)
    assert process.returncode == 0
    assert "everything of the page" in said
    assert "Traceback" not in said
    assert list(tmp_path.iterdir()) == []


def test_a_port_that_is_taken_is_refused(server):
    from rotorfit.app.server import ready

    port = server.sockets[0].getsockname()[1]
    with pytest.raises(OutputError, match=f"port {port} cannot be used"):
        ready(port=port)
