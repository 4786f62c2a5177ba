# SPDX-License-Identifier: Apache-2.0
"""The page's server: who is let in, which files can be had, what goes over the WebSocket; slow browsers slow nobody."""

import errno
import json
import signal
import socket
import struct
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

httpx = pytest.importorskip("httpx")
pytest.importorskip("starlette")
pytest.importorskip("uvicorn")
websockets = pytest.importorskip("websockets")

from websockets.sync.client import connect  # noqa: E402

from grasptrack import InputError  # noqa: E402
from grasptrack.files import hold_folder  # noqa: E402
from grasptrack.images import to_grey  # noqa: E402
from grasptrack.live import commands as told  # noqa: E402
from grasptrack.live import guard  # noqa: E402
from grasptrack.live.server import MOST_CLIENTS, PAGE, PageServer, bind_socket  # noqa: E402
from grasptrack.live.session import LiveSession  # noqa: E402
from recordings import movie, plate, plates, rows  # noqa: E402
from watched import camera_session, plate_session, reached, threads_left, threads_of_ours, until  # noqa: E402


@contextmanager
def served(session: LiveSession, **more: Any) -> Iterator[PageServer]:
    server = PageServer(session, **more)
    server.start()
    try:
        yield server
    finally:
        server.stop()


@contextmanager
def page_of_plate(folder: Path, **more: Any) -> Iterator[tuple[LiveSession, PageServer]]:
    with plate_session(folder, 6) as session:
        reached(session, "choosing")
        with served(session, **more) as server:
            yield session, server


def base(server: PageServer) -> str:
    return f"http://127.0.0.1:{server.port}"


def cookie(server: PageServer) -> dict[str, str]:
    return {"Cookie": f"grasptrack-{server.port}={server.token}"}


def get(server: PageServer, path: str, **more: str) -> Any:
    return httpx.get(f"{base(server)}{path}", headers={**cookie(server), **more})


def open_socket(server: PageServer, **more: str) -> Any:
    headers = {**cookie(server), **more}
    return connect(f"ws://127.0.0.1:{server.port}/socket", max_size=None, additional_headers=headers)


def next_moment(client: Any) -> tuple[dict[str, Any], bytes]:
    """The next moment and its JPEG; other messages are passed over."""
    while True:
        data = client.recv(timeout=30)
        if isinstance(data, bytes):
            return moment_of(client, data)


def moment_of(client: Any, data: bytes) -> tuple[dict[str, Any], bytes]:
    """A moment and its JPEG; drawing is told, without which no more of them come."""
    length = struct.unpack(">I", data[:4])[0]
    moment = json.loads(data[4 : 4 + length])
    client.send(json.dumps({"do": "drawn", "number": moment["number"]}))
    return moment, data[4 + length :]


def moment_until(client: Any, wanted: Any) -> tuple[dict[str, Any], bytes]:
    for _ in range(500):
        moment, jpeg = next_moment(client)
        if wanted(moment):
            return moment, jpeg
    raise AssertionError("never so")


def error_of(client: Any) -> str:
    while True:
        data = client.recv(timeout=30)
        if isinstance(data, bytes):
            moment_of(client, data)
        elif "error" in (said := json.loads(data)):
            return str(said["error"])


# --- what is served ------------------------------------------------------------------------------


def test_the_page_is_whole_and_needs_nothing_from_elsewhere(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (_, server):
        page = get(server, "/").text
        for name in PAGE:
            answer = get(server, f"/page/{name}")
            assert answer.status_code == 200 and answer.headers["content-type"].startswith(PAGE[name])
            assert "default-src 'none'" in answer.headers["content-security-policy"]
            for url in ("http://", "https://", "//cdn"):
                left = answer.text.replace("http://www.w3.org/2000/svg", "").replace("ws://", "")
                assert url not in left, f"{name} loads from elsewhere"
        assert "/page/app.js" in page


def test_a_moment_comes_with_its_image_once(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (session, server), open_socket(server) as client:
        until(session, lambda s: s.verdict is not None)
        told = [next_moment(client)]  # it may have the verdict already
        while told[-1][0]["verdict"] is None:
            told.append(next_moment(client))
        (jpeg,) = (each for moment, each in told if each and moment["image"] == 1)
        moment, shown = told[-1][0], session.shown
        assert shown.arrival is not None
        image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
        assert np.abs(image.astype(int) - to_grey(shown.arrival.frame.image)).mean() < 3.0
        assert moment["phase"] == "choosing" and moment["candidates"][0]["number"] == 1
        assert moment["verdict"]["level"] == "good" and moment["size"] == [320, 240]
        contacts = np.array(moment["result"]["contacts"])
        assert shown.result is not None and np.abs(contacts - shown.result.contacts).max() < 1e-3
        client.send(json.dumps({"do": "friction", "value": 0.7}))
        moment, jpeg = moment_until(client, lambda m: m["friction"] == 0.7)
        assert jpeg == b""


def test_a_page_that_comes_late_is_told_the_last_images(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (session, server):
        session.send_command(told.Start())
        reached(session, "ended", image=6)
        expected = [list(point) for point in session.curves.points_since(0)[1]]
        for _ in range(2):  # as a page that is loaded again
            with open_socket(server) as client:
                moment, _ = next_moment(client)
                assert moment["curves"] == expected and len(expected) == 6
                session.send_command(told.Friction(0.6))
                assert next_moment(client)[0]["curves"] == []


def test_clicks_come_in_and_the_run_goes_on_to_its_end(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (session, server), open_socket(server) as client:
        client.send(json.dumps({"do": "pick", "image": 1, "x": 150.0, "y": 100.0}))
        moment, _ = moment_until(client, lambda m: m["phase"] == "ended" and m["image"] == 6)
        assert moment["result"]["status"] == "tracked"
        assert session.shown.result is not None
    assert len(rows(tmp_path / "run")) == 6


MALFORMED: tuple[str | bytes, ...] = ("", "{", "[]", "null", b"\xff\xfe", "[" * 9000)
MALFORMED += ('{"do": "dance"}', '{"do": "pick"}', '{"do": "drawn", "number": "x"}')


def test_a_malformed_message_is_answered_by_one_line_and_the_socket_stays_open(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (_, server):
        for k, message in enumerate(MALFORMED):
            with open_socket(server) as client:
                client.send(message)
                line = error_of(client)
                assert line and "\n" not in line, message
                friction = 0.8 + 0.01 * k
                client.send(json.dumps({"do": "friction", "value": friction}))
                moment_until(client, lambda m, friction=friction: m["friction"] == friction)


def test_who_sends_nothing_but_nonsense_or_too_much_is_sent_away(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (session, server):
        with open_socket(server) as client, pytest.raises(websockets.exceptions.ConnectionClosed):
            for _ in range(400):
                client.send("nonsense")
                client.recv(timeout=30)
        with open_socket(server) as client, pytest.raises(websockets.exceptions.ConnectionClosed):
            client.send("x" * 70_000)
            while True:
                client.recv(timeout=30)
        assert session.is_running
        with open_socket(server) as client:
            next_moment(client)


# --- files ---------------------------------------------------------------------------------------


def test_files_of_the_run_can_be_had_and_no_others(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (session, server):
        secret = tmp_path / "run" / "secret.txt"
        secret.write_text("a file of the user's own")
        (tmp_path / "outside.csv").write_text("beside the run")
        got = get(server, "/files/grasps.csv")
        assert got.status_code == 200 and got.text.startswith("frame,time_s,status")
        assert got.headers["content-disposition"] == 'attachment; filename="grasps.csv"'
        for name in (
            "secret.txt", "../outside.csv", "..%2foutside.csv", "%2e%2e/outside.csv", "..%5coutside.csv",
            "/etc/passwd", "%2fetc%2fpasswd", "grasps.csv/../../outside.csv", "grasps.csv%00", "goal.json", "", ".",
            "..",
        ):  # fmt: skip
            answer = raw_get(server, f"/files/{name}")
            assert answer.startswith((b"HTTP/1.1 404", b"HTTP/1.1 400", b"HTTP/1.1 307")), (name, answer[:60])
            assert b"beside the run" not in answer and b"root:" not in answer and b"own" not in answer
        for name in ("../server.py", "%2e%2e/server.py", "..%2fserver.py"):
            assert raw_get(server, f"/page/{name}").startswith(b"HTTP/1.1 404")
        assert session.written_file("secret.txt") is None and session.written_file("../outside.csv") is None


def raw_get(server: PageServer, target: str, host: str | None = None) -> bytes:
    """As no client that tidies addresses up would ask; the token is known."""
    with socket.create_connection(("127.0.0.1", server.port), 10) as link:
        name = f"127.0.0.1:{server.port}" if host is None else host
        known = f"Cookie: {cookie(server)['Cookie']}\r\nConnection: close"
        link.sendall(f"GET {target} HTTP/1.1\r\nHost: {name}\r\n{known}\r\n\r\n".encode("latin-1"))
        answer = b""
        while piece := link.recv(65536):
            answer += piece
    return answer


# --- who is let in -------------------------------------------------------------------------------


def test_another_site_is_refused(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (_, server):
        for origin in ("http://evil.example", f"http://127.0.0.1:{server.port}.evil.example", "null", "http://["):
            assert get(server, "/files/grasps.csv", origin=origin).status_code == 403
            with pytest.raises(websockets.exceptions.InvalidStatus), open_socket(server, Origin=origin):
                pass
        with open_socket(server, Origin=base(server)) as client:
            next_moment(client)
        assert httpx.post(server.url).status_code == 405


def test_under_any_name_and_port_the_token_is_enough_and_nothing_is_answered_without_it(tmp_path: Path) -> None:
    """As through a tunnel, out of a container, or by a name that only the network knows."""
    with page_of_plate(tmp_path) as (_, server):
        for host, port in (("localhost:9000", 9000), ("robot.local", 80), ("[::1]", 80), ("192.168.7.9:8321", 8321)):
            asked = httpx.get(server.url, headers={"host": host})
            kept = asked.headers["set-cookie"].partition(";")[0]
            assert asked.status_code == 200 and kept == f"grasptrack-{port}={server.token}"
            known = {"host": host, "cookie": kept}
            assert httpx.get(f"{base(server)}/", headers=known).status_code == 200
            assert httpx.get(f"{base(server)}/", headers={"host": host}).status_code == 403
            assert httpx.get(f"{base(server)}/", headers={**known, "origin": "http://evil.example"}).status_code == 403
        for host in ("", "a b", "[", "evil.example:80:80"):
            assert raw_get(server, "/", host).startswith((b"HTTP/1.1 403", b"HTTP/1.1 400")), host


def test_with_a_token_nothing_is_answered_without_it(tmp_path: Path) -> None:
    with page_of_plate(tmp_path, token="wKq3-token") as (_, server):
        assert server.url.endswith("/?token=wKq3-token")
        for path in ("/", "/page/app.js", "/files/grasps.csv", "/nothing"):
            for query in ("", "?token=", "?token=wrong", "?token=wKq3-toke", "?token=%ff"):
                answer = httpx.get(f"{base(server)}{path}{query}")
                assert answer.status_code == 403 and "token" in answer.text and "wKq3" not in answer.text
        for wrong in ("", f"grasptrack-{server.port}=wrong", "=;;grasptrack"):
            with pytest.raises(websockets.exceptions.InvalidStatus), open_socket(server, Cookie=wrong):
                pass
        with httpx.Client() as browser:
            assert browser.get(server.url).status_code == 200
            assert browser.get(f"{base(server)}/page/app.js").status_code == 200  # by the cookie
            assert browser.get(f"{base(server)}/files/grasps.csv").status_code == 200
            (found,) = browser.cookies.jar
        assert found.has_nonstandard_attr("HttpOnly") and found.get_nonstandard_attr("SameSite") == "Strict"
        with open_socket(server, Cookie=f"{found.name}={found.value}") as client:
            next_moment(client)


def test_the_addresses_that_are_printed_are_those_at_which_it_is_reached(tmp_path: Path) -> None:
    with plate_session(tmp_path, 2) as session:
        for host, name in (("127.0.0.1", None), ("localhost", None), ("0.0.0.0", None), ("0.0.0.0", "robot.local")):
            with served(session, host=host, name=name) as server:
                assert len(server.token) >= 32 and all(url.endswith(f"/?token={server.token}") for url in server.urls)
                assert not any("0.0.0.0" in url for url in server.urls)
                if name is None:
                    assert all(httpx.get(url).status_code == 200 for url in server.urls)
                else:
                    assert server.urls == [f"http://{name}:{server.port}/?token={server.token}"]


# --- slow, many, gone ----------------------------------------------------------------------------


def test_a_browser_that_never_draws_slows_nobody_and_gets_the_newest_when_it_does(tmp_path: Path) -> None:
    with camera_session(tmp_path, plate(), at_once=True) as (session, camera):
        reached(session, "tracking", image=1)
        with served(session) as server, open_socket(server) as slow:
            numbers = []
            for k in range(60):
                camera.images.put(plate((160.0 + 0.2 * k, 120.0)))
                reached(session, "tracking", image=2 + k)
            while True:
                try:
                    data = slow.recv(timeout=0.5)
                except TimeoutError:
                    break
                if isinstance(data, bytes):
                    numbers.append(json.loads(data[4 : 4 + struct.unpack(">I", data[:4])[0]])["number"])
            assert 1 <= len(numbers) <= 3  # no more than are on their way
            slow.send(json.dumps({"do": "drawn", "number": numbers[-1]}))
            moment, jpeg = next_moment(slow)
            assert moment["image"] == 61 and jpeg


def test_only_so_many_look_on_and_who_goes_makes_room(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (_, server), ExitStack() as stack:
        clients = [stack.enter_context(open_socket(server)) for _ in range(MOST_CLIENTS)]
        for client in clients:
            next_moment(client)
        with open_socket(server) as one_more, pytest.raises(websockets.exceptions.ConnectionClosed):
            one_more.recv(timeout=30)
        clients.pop().close()
        until_clients(server, MOST_CLIENTS - 1)
        with open_socket(server) as client:
            next_moment(client)
        for client in clients:
            client.close()
        until_clients(server, 0)
        assert server.hub.session._listeners == []  # nobody looks on: nothing is done for a page


def is_closed(link: socket.socket) -> bool:
    link.setblocking(False)
    try:
        return link.recv(1 << 16) == b""
    except BlockingIOError:
        return False
    except ConnectionError:
        return True


def test_connections_that_show_no_token_leave_the_run_its_files_and_keep_nobody_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with page_of_plate(tmp_path) as (_, server), ExitStack() as stack, open_socket(server) as client:
        next_moment(client)
        links = [stack.enter_context(socket.create_connection(("127.0.0.1", server.port), 10)) for _ in range(320)]
        for link in links[::2]:
            with suppress(OSError):
                link.sendall(b"GET / HTTP/1.1\r\nHost: x\r\nX-Slow: ")
        assert get(server, "/").status_code == 200
        client.send(json.dumps({"do": "friction", "value": 0.7}))
        moment_until(client, lambda m: m["friction"] == 0.7)
        assert 200 < sum(not is_closed(link) for link in links) <= guard.MOST_CONNECTIONS
        monkeypatch.setattr(guard, "PATIENCE", 0.2)
        end = time.monotonic() + 20
        while not all(is_closed(link) for link in links):
            assert time.monotonic() < end
            time.sleep(0.1)
        client.send(json.dumps({"do": "friction", "value": 0.6}))  # who has shown it stays
        moment_until(client, lambda m: m["friction"] == 0.6)


@pytest.mark.parametrize("number", [errno.EMFILE, errno.ENFILE])
def test_a_process_without_descriptors_takes_no_connection_and_says_nothing(
    monkeypatch: pytest.MonkeyPatch, number: int
) -> None:
    def full(_: socket.socket) -> Any:
        raise OSError(number, "Too many open files")

    with bind_socket("127.0.0.1", 0) as door:
        monkeypatch.setattr(socket.socket, "accept", full)
        with pytest.raises(BlockingIOError):
            door.accept()


def until_clients(server: PageServer, count: int) -> None:
    end = time.monotonic() + 20
    while server.hub.clients != count:
        assert time.monotonic() < end
        time.sleep(0.02)


def test_a_port_that_is_taken_is_told(tmp_path: Path) -> None:
    with page_of_plate(tmp_path) as (session, server):
        with pytest.raises(InputError, match=f"port {server.port}"):
            PageServer(session, port=server.port)
        with pytest.raises(InputError, match="cannot be served"):
            PageServer(session, "no.such.host.example")


def test_a_port_that_is_taken_leaves_an_earlier_runs_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from grasptrack.cli.main import main

    with page_of_plate(tmp_path) as (_, server):
        (tmp_path / "out").mkdir()
        (tmp_path / "out" / "grasps.csv").write_text("of an earlier run")
        (tmp_path / "out" / "run.json").write_text('{"versions": {"grasptrack": "0"}, "files": ["grasps.csv"]}')
        command = ["live", str(tmp_path / "in"), "--output", str(tmp_path / "out"), "--port", str(server.port)]
        assert main(command) == 2
    assert f"port {server.port}" in capsys.readouterr().err
    assert (tmp_path / "out" / "grasps.csv").read_text() == "of an earlier run"


def test_two_pages_do_not_write_to_one_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from grasptrack.cli.main import main

    command = ["live", str(plates(tmp_path / "in", 2)), "--port", "0", "--start", "--output", str(tmp_path / "out")]
    with hold_folder(tmp_path / "out"):
        run = subprocess.run([sys.executable, "-m", "grasptrack.cli.main", *command], capture_output=True, text=True)
    assert run.returncode == 2 and run.stderr.count("\n") == 1 and "another run" in run.stderr
    assert main([*command, "--until-end"]) == 0
    assert "grasps.csv" in capsys.readouterr().out


def test_nothing_of_a_server_is_left(tmp_path: Path) -> None:
    before = threads_of_ours()
    with ExitStack() as stack:
        with page_of_plate(tmp_path) as (_, server):
            client = stack.enter_context(open_socket(server))
            next_moment(client)
        assert threads_left(before) == set()
        with pytest.raises(websockets.exceptions.ConnectionClosed):
            while True:
                client.recv(timeout=10)


# --- the command ---------------------------------------------------------------------------------


@pytest.mark.sampled(1)
@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_ctrl_c_leaves_whole_files(tmp_path: Path, ending: signal.Signals) -> None:
    command = [sys.executable, "-m", "grasptrack.cli.main", "live", str(plates(tmp_path / "in", 4)), "--start"]
    run = subprocess.Popen(
        [*command, "--port", "0", "--output", str(tmp_path / "out")], stdout=subprocess.PIPE, text=True
    )
    assert run.stdout is not None
    url = run.stdout.readline().split()[0]
    with connect(url.replace("http", "ws", 1).replace("/?", "/socket?"), max_size=None) as client:
        moment_until(client, lambda m: m["phase"] == "ended")
    run.send_signal(ending)
    rest, _ = run.communicate(timeout=60)
    assert run.returncode == 0 and "grasps.csv" in rest
    assert len(rows(tmp_path / "out")) == 4
    assert json.loads((tmp_path / "out" / "run.json").read_text())["ended"] == "finished"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["nothing.mp4"], "does not exist"),
        (["film.mp4", "--record-as", "gif"], "--record-as"),
        (["film.mp4", "--fingers", "5"], "2 or 3 fingers"),
        (["film.mp4", "--host", "no.such.host.example"], "cannot be served"),
        (["film.mp4", "--name", "http://robot.local"], "--name is the name or address of a machine"),
        (["film.mp4", "--strategy", "grasp-line", "--fingers", "3"], "grasp-line"),
        (["film.mp4", "--object", "1,2", "--box", "1,2,3,4"], "give one of them"),
        (["camera:77"], "camera 77 cannot be opened"),
    ],
)
def test_bad_input_is_one_line_and_status_2(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], arguments: list[str], told: str
) -> None:
    from grasptrack.cli.main import main

    monkeypatch.chdir(tmp_path)
    movie(tmp_path / "film.mp4", 3)
    assert main(["live", *arguments]) == 2
    said = capsys.readouterr().err
    assert told in said and said.count("\n") == 1
