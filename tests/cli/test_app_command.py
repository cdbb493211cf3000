"""rotorfit app: what is refused before a page is served; tests/app has the server itself."""

import socket
import sys

import pytest


def test_without_the_extra_one_line_says_how_to_get_it(refused, tmp_path, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    monkeypatch.delitem(sys.modules, "rotorfit.app.server", raising=False)
    assert "pip install 'rotorfit[app]'" in refused("app", "--no-browser")


def test_a_port_that_is_taken_is_refused(refused, tmp_path, monkeypatch) -> None:
    pytest.importorskip("uvicorn", reason="the page needs the extra app")
    monkeypatch.chdir(tmp_path)
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        assert f"port {port} cannot be used" in refused("app", "--no-browser", "--port", port)


def test_ports_there_are_not(run) -> None:
    assert run("app", "--port", 70_000).code == 2
    assert run("app", "--limit", 0).code == 2
