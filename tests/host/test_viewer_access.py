from __future__ import annotations

import socket
import time
from collections.abc import Iterator
from pathlib import Path

import httpx
import pytest

from host.viewer_rig import SmallViewer, small_viewer
from prismstereo.viewer.access import Access
from prismstereo.viewer.records import Records
from prismstereo.viewer.serving import ViewerServer
from prismstereo_hw.errors import UsageError
from prismstereo_hw.rig import Rig


@pytest.fixture(scope="module")
def viewer(small: Rig, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SmallViewer]:
    with small_viewer(small, tmp_path_factory.mktemp("records")) as viewer:
        yield viewer


@pytest.fixture(scope="module")
def guarded(viewer: SmallViewer) -> Iterator[ViewerServer]:
    with ViewerServer(viewer.hub, address="0.0.0.0") as server:
        yield server


def asked(viewer: SmallViewer, method: str, path: str, **headers: str) -> httpx.Response:
    return viewer.client.request(method, path, headers=headers, content=b"{}" if method == "POST" else None)


def test_it_listens_on_loopback_and_nowhere_else_unless_told(viewer: SmallViewer) -> None:
    assert viewer.server.address[0] == "127.0.0.1"
    assert "#" not in viewer.server.url


def test_the_page_and_all_its_parts_come_from_here_with_headers_that_keep_it_so(viewer: SmallViewer) -> None:
    page = asked(viewer, "GET", "/")

    assert page.status_code == 200
    assert page.headers["content-security-policy"].startswith("default-src 'self';")
    assert page.headers["x-content-type-options"] == "nosniff"
    assert "://" not in page.text
    for name in ("main.js", "style.css", "icon.svg", "shaders.js"):
        assert asked(viewer, "GET", f"/{name}").status_code == 200


@pytest.mark.parametrize(
    "host", ["evil.example", "evil.example:80", "localhost.evil.example", "10.0.0.7", "", "127.0.0.1@evil.example"]
)
def test_a_foreign_host_is_refused(viewer: SmallViewer, host: str) -> None:
    assert asked(viewer, "GET", "/", host=host).status_code in (400, 403)


@pytest.mark.parametrize("host", ["localhost:1234", "127.0.0.1:1", "[::1]:9", "127.4.5.6"])
def test_any_name_of_this_machine_will_do_for_a_tunnel_to_it(viewer: SmallViewer, host: str) -> None:
    assert asked(viewer, "GET", "/api/state", host=host).status_code == 200


@pytest.mark.parametrize(
    "origin", [None, "null", "http://evil.example", "https://127.0.0.1", "file://", "http://127.0.0.1:1"]
)
def test_what_another_page_posts_is_refused(viewer: SmallViewer, origin: str | None) -> None:
    headers = {} if origin is None else {"origin": origin}

    assert asked(viewer, "POST", "/api/record", **headers).status_code == 403
    assert viewer.hub.desk.tape is None


MUTATING = ("enter", "set", "record", "still", "background", "optics", "check", "play", "pause", "live")


@pytest.mark.parametrize("action", MUTATING)
def test_nothing_changes_by_get(viewer: SmallViewer, action: str) -> None:
    assert asked(viewer, "GET", f"/api/{action}").status_code == 405


@pytest.mark.parametrize("method", ["PUT", "DELETE", "OPTIONS", "PATCH", "TRACE"])
def test_no_other_method_is_known(viewer: SmallViewer, method: str) -> None:
    assert asked(viewer, method, "/api/state").status_code == 405


def test_a_body_that_is_too_large_is_refused_before_it_is_read(viewer: SmallViewer) -> None:
    origin = f"http://{viewer.host}"
    declared = viewer.client.post("/api/set", content=b"{" * 100_000, headers={"origin": origin})
    secret = viewer.client.post("/api/set", content=(b"{" * 60_000 for _ in range(3)), headers={"origin": origin})

    assert (declared.status_code, secret.status_code) == (413, 413)


@pytest.mark.parametrize(
    "body", [b"[]", b'{"name": 3}', b"\xff", b'{"name": "gain", "value": 2, "more": 1}', b"[" * 40_000]
)
def test_a_body_that_is_no_request_is_refused_in_one_sentence(viewer: SmallViewer, body: bytes) -> None:
    origin = f"http://{viewer.host}"
    answer = viewer.client.post("/api/set", content=body, headers={"origin": origin})

    assert answer.status_code == 400
    assert "cannot be read" in answer.json()["error"]


def test_any_other_address_makes_a_token_that_stands_behind_the_hash_alone(guarded: ViewerServer) -> None:
    token = guarded.access.token

    assert token is not None
    assert len(token) >= 22  # 128 bits in base 64
    assert guarded.url.partition("#")[2] == f"token={token}"


def test_without_the_token_only_the_page_itself_is_given_out(guarded: ViewerServer) -> None:
    with httpx.Client(base_url=f"http://127.0.0.1:{guarded.port}", verify=False) as client:
        assert client.get("/").status_code == 200
        for path in ("/api/state", "/api/records", "/files/a/stills/000000.png"):
            assert client.get(path).status_code == 401
            assert client.get(path, headers={"authorization": "Bearer wrong"}).status_code == 401
            assert client.get(path, headers={"cookie": "prismstereo=wrong"}).status_code == 401


def test_a_browser_that_shows_the_token_gets_a_cookie_that_no_script_and_no_other_page_can_use(
    guarded: ViewerServer,
) -> None:
    base = f"http://127.0.0.1:{guarded.port}"
    with httpx.Client(base_url=base, headers={"origin": base}, verify=False) as client:
        assert client.post("/api/enter", json={"token": "wrong"}).status_code == 401
        entered = client.post("/api/enter", json={"token": guarded.access.token})
        state = client.get("/api/state")

    cookie = entered.headers["set-cookie"]
    assert "HttpOnly" in cookie
    assert "SameSite=strict" in cookie
    assert guarded.access.token not in cookie
    assert state.status_code == 200


def test_a_name_that_somebody_pointed_here_is_refused_on_every_address(guarded: ViewerServer) -> None:
    with httpx.Client(base_url=f"http://127.0.0.1:{guarded.port}", verify=False) as client:
        for host in ("evil.example", "127.0.0.1.evil.example"):
            assert client.get("/", headers={"host": host}).status_code == 403
        assert client.get("/", headers={"host": "192.168.1.5:80"}).status_code == 200  # a number points nowhere else


@pytest.mark.parametrize(
    "name",
    ["../secret.mcap", "..", ".", "/etc/passwd", "a/b.mcap", "x\0.mcap", "CON", "l" * 300 + ".mcap", "link.mcap",
     ".hidden.mcap", "ｘ.mcap"],
)  # fmt: skip
def test_a_name_that_is_not_one_of_the_folder_opens_nothing(tmp_path: Path, name: str) -> None:
    (tmp_path / "secret.mcap").write_bytes(b"secret")
    folder = tmp_path / "records"
    folder.mkdir()
    (folder / "link.mcap").symlink_to(tmp_path / "secret.mcap")
    records = Records(folder)

    assert records.listed() == []
    with pytest.raises(UsageError, match="there is no recording"):
        records.recording(name)


@pytest.mark.parametrize(
    "inside", ["../../secret", "stills/../session.toml", "session.toml", "stills/000000.png/..", "background/other.png"]
)
def test_of_a_session_only_its_pictures_are_given_out(tmp_path: Path, inside: str) -> None:
    session = tmp_path / "one-session"
    (session / "stills").mkdir(parents=True)
    (session / "session.toml").write_text("x")
    (session / "stills" / "000000.png").write_bytes(b"png")
    records = Records(tmp_path)

    assert records.picture("one-session", "stills/000000.png").read_bytes() == b"png"
    with pytest.raises(UsageError, match="there is no picture"):
        records.picture("one-session", inside)


@pytest.mark.parametrize(
    "path",
    [
        "/files/..%2f..%2fetc/passwd",
        "/files/../../etc/passwd",
        "/..%2f..%2faccess.py",
        "/static/../access.py",
        "/%2e%2e/access.py",
    ],
)
def test_no_path_leads_out_of_the_page(viewer: SmallViewer, path: str) -> None:
    with socket.create_connection(("127.0.0.1", viewer.server.port), timeout=5) as line:
        line.sendall(f"GET {path} HTTP/1.1\r\nHost: {viewer.host}\r\nConnection: close\r\n\r\n".encode())
        answer = line.makefile("rb").read()

    assert answer.split(b"\r\n")[0].split()[1] == b"404"
    assert b"import" not in answer


def test_two_hundred_silent_connections_do_not_keep_a_person_out(viewer: SmallViewer) -> None:
    silent = [socket.create_connection(("127.0.0.1", viewer.server.port), timeout=5) for _ in range(200)]
    try:
        began_s = time.monotonic()
        answer = asked(viewer, "GET", "/api/state")
        closed = sum(_is_closed(line) for line in silent)
    finally:
        for line in silent:
            line.close()

    assert answer.status_code == 200
    assert time.monotonic() - began_s < 5
    assert closed >= 100


def _is_closed(line: socket.socket) -> bool:
    line.settimeout(0)
    try:
        return line.recv(1) == b""
    except BlockingIOError:
        return False
    except OSError:
        return True


def test_a_token_is_compared_whole_and_never_the_cookie_itself() -> None:
    access = Access.to("192.168.1.5")

    assert access.token is not None
    assert access.opens(access.token)
    assert not access.opens(access.token[:-1])
    assert not access.opens(access.entrance)
    assert not access.admits(access.token, None)
    assert access.admits(None, f"Bearer {access.token}")
