"""The server: this machine only, new files make a new page, bad files say so."""

from __future__ import annotations

import http.client
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from qsframework.errors import InputError
from qsframework.viz import SceneSite, serve


@contextmanager
def running(site: SceneSite) -> Iterator[tuple[str, int]]:
    with serve(site, 0) as server:
        thread = threading.Thread(target=server.serve_forever, daemon=True)
        thread.start()
        yield server.server_address[0], server.server_address[1]  # pyright: ignore[reportReturnType]
        server.shutdown()
        thread.join()


def ask(port: int, path: str, host: str = "127.0.0.1") -> tuple[int, str]:
    connection = http.client.HTTPConnection("127.0.0.1", port, timeout=120)
    connection.request("GET", path, headers={"Host": f"{host}:{port}"})
    answer = connection.getresponse()
    return answer.status, answer.read().decode()


def test_it_listens_on_this_machine_only() -> None:
    if not Path("/proc/net/tcp").exists():
        pytest.skip("this system does not list who listens in /proc/net/tcp")
    with running(SceneSite(lambda watch: "page", [])) as (host, port):
        assert host == "127.0.0.1"
        listening = [
            line.split()[1] for line in Path("/proc/net/tcp").read_text().splitlines()[1:] if line.split()[3] == "0A"
        ]
        here = [address for address in listening if int(address.split(":")[1], 16) == port]
        assert here == [f"0100007F:{port:04X}"]  # 127.0.0.1, least byte first
        with socket.socket() as other:
            other.settimeout(2)
            with pytest.raises(OSError):  # another address of this machine is not served
                other.connect(("127.0.0.2", port))


def test_another_hosts_name_is_refused() -> None:
    """A page from elsewhere cannot read the scene by pointing its own name at this machine."""
    with running(SceneSite(lambda watch: "page", [])) as (_, port):
        assert ask(port, "/")[0] == 200
        assert ask(port, "/", "localhost")[0] == 200
        assert ask(port, "/", "evil.example")[0] == 403
        assert ask(port, "/etc/passwd")[0] == 404
        assert ask(port, "/../server.py")[0] == 404


def test_a_client_that_leaves_is_no_traceback(capfd: pytest.CaptureFixture[str]) -> None:
    gone = threading.Event()

    def page(watch: str) -> str:
        gone.wait(10.0)
        return "x" * 20_000_000

    with running(SceneSite(page, [])) as (_, port):
        with socket.create_connection(("127.0.0.1", port)) as client:
            client.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))  # leaves at once
            client.sendall(f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode())
        gone.set()
        assert ask(port, "/changed")[0] == 200
        assert ask(port, "/")[0] == 200
    assert capfd.readouterr().err == ""


def test_a_changed_file_makes_a_new_page(tmp_path: Path) -> None:
    file = tmp_path / "a.txt"
    file.write_text("one")
    made = []

    def make(watch: str) -> str:
        made.append(watch)
        return file.read_text()

    with running(SceneSite(make, [file])) as (_, port):
        assert ask(port, "/") == (200, "one")
        assert ask(port, "/") == (200, "one")
        before = ask(port, made[0])[1]
        assert len(made) == 1
        file.write_text("two, and longer")
        import os

        os.utime(file, ns=(1, 1))
        assert ask(port, made[0])[1] != before
        assert ask(port, "/") == (200, "two, and longer")


def test_a_file_that_has_become_wrong_is_told_on_the_page(tmp_path: Path) -> None:
    def make(watch: str) -> str:
        raise InputError("line 3: <b>no unit</b>")

    with running(SceneSite(make, [])) as (_, port):
        status, page = ask(port, "/")
    assert status == 200
    assert "line 3: &lt;b&gt;no unit" in page


def test_a_port_that_is_taken_is_an_error() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        with pytest.raises(InputError, match=f"port {port} cannot be listened on.*give another one"):
            serve(SceneSite(lambda watch: "", []), port)


@pytest.mark.parametrize("port", [-1, 70000])
def test_a_port_must_be_one(port: int) -> None:
    with pytest.raises(InputError, match="allowed: 0"):
        serve(SceneSite(lambda watch: "", []), port)
