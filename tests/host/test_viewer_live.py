from __future__ import annotations

import json
import time
import zlib
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from websockets.exceptions import ConnectionClosed, InvalidStatus
from websockets.sync.client import ClientConnection, connect

from host.viewer_rig import SmallViewer, small_viewer
from prismstereo.viewer.message import Kind, packed_steps
from prismstereo_device.disparity import DisparityMap
from prismstereo_hw.rig import Rig


@pytest.fixture
def fresh(small: Rig, tmp_path: Path) -> Iterator[SmallViewer]:
    with small_viewer(small, tmp_path / "records") as viewer:
        yield viewer


@pytest.fixture(scope="module")
def viewer(small: Rig, tmp_path_factory: pytest.TempPathFactory) -> Iterator[SmallViewer]:
    """A viewer that has shown frames before, to other browsers."""
    with small_viewer(small, tmp_path_factory.mktemp("records")) as viewer:
        yield viewer


@contextmanager
def opened(viewer: SmallViewer, **options: Any) -> Iterator[ClientConnection]:
    """Join as a browser does, and take the newest frame, if there was one."""
    with connect(f"ws://{viewer.host}/live", origin=f"http://{viewer.host}", **options) as line:
        if viewer.sent:
            next_frame(line)
            line.send('{"ack": [1]}')
        yield line


def unpacked(message: bytes) -> tuple[int, dict[str, Any], bytes]:
    length = int.from_bytes(message[2:4], "little")
    return message[0], json.loads(message[4 : 4 + length]), message[4 + length :]


def steps_of(head: dict[str, Any], body: bytes) -> np.ndarray:
    """Unpack a map as the page does, with other words."""
    low, high = np.frombuffer(zlib.decompress(body), np.uint8).reshape(2, head["height"], head["width"]).astype(int)
    folded = low + 256 * high
    change = np.where(folded % 2, -(folded + 1) // 2, folded // 2)
    return np.cumsum(change, axis=1) % 65536


def next_frame(line: ClientConnection, timeout_s: float = 5.0) -> bytes:
    while not isinstance(message := line.recv(timeout_s), bytes):
        pass
    return message


def next_word(line: ClientConnection, kind: str) -> Any:
    while True:
        message = line.recv(5.0)
        if isinstance(message, str) and json.loads(message)["type"] == kind:
            return json.loads(message)["what"]


def until_closed(line: ClientConnection) -> None:
    while True:
        line.recv(5)


def test_a_frame_arrives_exactly_as_the_camera_sent_it(viewer: SmallViewer) -> None:
    with opened(viewer) as line:
        sent = viewer.send()
        kind, head, body = unpacked(next_frame(line))

    assert kind == Kind.DISPARITY
    np.testing.assert_array_equal(steps_of(head, body), sent.fixed_point())
    assert head["scale_px"] == pytest.approx(viewer.made.window.scale_px, rel=1e-6)
    assert head["projection"]["focal_px"] == pytest.approx(viewer.made.focal_px)
    assert head["projection"]["cx_px"] == pytest.approx(viewer.made.left.cx_px)


def test_any_map_survives_the_packing(rng: np.random.Generator) -> None:
    steps = rng.integers(0, 65536, (7, 11)).astype(np.uint16)

    found = steps_of({"width": 11, "height": 7}, packed_steps(steps))

    np.testing.assert_array_equal(found, steps)


def test_the_page_is_told_the_geometry_before_the_first_frame_and_the_state_every_second(fresh: SmallViewer) -> None:
    fresh.send()
    with opened(fresh) as line:
        status = next_word(line, "status")
    with connect(f"ws://{fresh.host}/live", origin=f"http://{fresh.host}") as line:
        geometry = next_word(line, "geometry")

    assert status["frames"] == 1
    assert status["calibration"]["advice"] == "unknown"
    assert geometry["baseline"] == pytest.approx(fresh.calibration.baseline)
    assert geometry["raw"]["left"] == list(fresh.calibration.left_view.rectangle(320, 180))


def test_a_page_that_does_not_acknowledge_skips_frames_and_nobody_else_does(viewer: SmallViewer) -> None:
    with opened(viewer) as slow, opened(viewer) as quick:
        begin = viewer.sent
        for number in range(8):
            viewer.send()
            _, head, _ = unpacked(next_frame(quick))
            assert head["frame"] == begin + number
            quick.send('{"ack": [1]}')
        _, first, _ = unpacked(next_frame(slow))
        slow.send('{"ack": [1]}')
        _, second, _ = unpacked(next_frame(slow))

    assert (first["frame"], second["frame"]) == (begin, begin + 7)  # what lay between was never sent
    assert viewer.hub.desk.camera.statistics.not_taken == 0


def test_a_page_that_does_not_even_read_costs_the_server_one_frame_of_each_kind(fresh: SmallViewer) -> None:
    with opened(fresh, max_queue=1, close_timeout=0.2) as deaf:
        for _ in range(30):
            fresh.send()
        deadline_s = time.monotonic() + 5
        while fresh.hub.desk.camera.statistics.frames < 30 and time.monotonic() < deadline_s:
            time.sleep(0.01)
        client = fresh.hub._clients[0]
        assert fresh.hub.desk.camera.statistics.frames == 30
        assert client.sent <= 2
        assert deaf.state.name == "OPEN"


@pytest.mark.parametrize("origin", [None, "null", "http://evil.example", "http://127.0.0.1:1"])
def test_a_foreign_page_gets_no_live_connection(viewer: SmallViewer, origin: str | None) -> None:
    with pytest.raises(InvalidStatus) as refused, connect(f"ws://{viewer.host}/live", origin=origin):
        pass

    assert refused.value.response.status_code == 403


def test_a_name_that_was_pointed_here_gets_no_live_connection(viewer: SmallViewer) -> None:
    headers = {"Host": "evil.example"}
    with (
        pytest.raises(InvalidStatus),
        connect(f"ws://{viewer.host}/live", origin="http://evil.example", additional_headers=headers),
    ):
        pass


def test_a_message_of_a_hundred_megabytes_ends_the_connection_before_it_is_there(viewer: SmallViewer) -> None:
    with opened(viewer) as line:
        with pytest.raises((ConnectionClosed, OSError)):
            line.send([b"x" * 262_144] * 400)
        with pytest.raises(ConnectionClosed) as closed:
            until_closed(line)

    assert closed.value.rcvd is None or closed.value.rcvd.code == 1009


@pytest.mark.parametrize(
    "word",
    [
        "no json",
        "[]",
        '{"ack": "all"}',
        '{"ack": [1], "more": 2}',
        "[" * 4000,
        "\ud800".encode("utf-8", "surrogatepass"),
    ],
)
def test_words_that_cannot_be_read_end_the_connection(viewer: SmallViewer, word: str | bytes) -> None:
    with opened(viewer) as line:
        line.send(word)
        with pytest.raises(ConnectionClosed):
            until_closed(line)


def test_acknowledging_what_was_never_sent_changes_nothing(viewer: SmallViewer) -> None:
    with opened(viewer) as line:
        line.send('{"ack": [1, 2, 99, -5]}')
        viewer.send()
        assert unpacked(next_frame(line))[1]["frame"] == viewer.sent - 1


def test_the_seventeenth_browser_is_told_to_come_again_later(viewer: SmallViewer) -> None:
    with ExitStack() as stack:
        for _ in range(16):
            stack.enter_context(opened(viewer))
        one_more = stack.enter_context(connect(f"ws://{viewer.host}/live", origin=f"http://{viewer.host}"))
        with pytest.raises(ConnectionClosed) as closed:
            one_more.recv(5)

    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == 1013


def test_the_camera_sends_what_pages_show_and_is_as_it_was_when_they_are_gone(fresh: SmallViewer) -> None:
    settings = fresh.answering.settings
    with opened(fresh) as line:
        line.send('{"show": ["left", "pair", "why"]}')
        assert _comes(lambda: (settings["preview"], settings["raw"], settings["reasons"]) == (True, True, True))
        line.send('{"show": ["left"]}')
        assert _comes(lambda: (settings["preview"], settings["raw"], settings["reasons"]) == (True, False, False))

    assert _comes(lambda: settings["preview"] is False)


def test_a_setting_is_changed_or_refused_in_the_words_of_the_camera(viewer: SmallViewer) -> None:
    good = viewer.post("set", {"name": "gain", "value": 2.5})
    bad = viewer.post("set", {"name": "gain", "value": 90})
    details = viewer.client.get("/api/state").json()["details"]

    assert good.json() == {"name": "gain", "value": 2.5}
    assert bad.status_code == 400
    assert "from 1 to 8" in bad.json()["error"]
    assert details["values"]["gain"] == 2.5


def test_frames_of_half_the_size_have_half_the_focal_length_and_the_same_points(viewer: SmallViewer) -> None:
    width, height = viewer.made.width // 2, viewer.made.height // 2
    full = viewer.made.window
    half = DisparityMap(
        np.full((height, width), 8.0, np.float32), type(full)(full.labels // 2, full.offset_px / 2, full.scale_px / 2)
    )
    with opened(viewer) as line:
        viewer.send(half)
        _, head, _ = unpacked(next_frame(line))

    projection = head["projection"]
    assert projection["focal_px"] == pytest.approx(viewer.made.focal_px / 2)
    assert projection["cx_px"] == pytest.approx((viewer.made.left.cx_px + 0.5) / 2 - 0.5)
    assert not projection["glass"]


def test_a_viewer_that_is_recording_writes_a_file_that_another_reader_accepts(fresh: SmallViewer) -> None:
    from mcap.reader import make_reader

    begun = fresh.post("record", {"on": True})
    assert begun.status_code == 200, begun.text
    name = begun.json()["tape"]["name"]
    for _ in range(4):
        fresh.send()
        time.sleep(0.02)
    assert _comes(lambda: fresh.hub.desk.camera.statistics.frames == 4)
    ended = fresh.post("record", {"on": False}).json()["ended"]
    listed = fresh.client.get("/api/records").json()["records"]
    played = fresh.post("play", {"name": name})
    with connect(f"ws://{fresh.host}/live", origin=f"http://{fresh.host}") as line:
        kind, _, _ = unpacked(next_frame(line))

    assert ended["problem"] == ""
    assert [one["name"] for one in listed] == [name]
    with (fresh.hub.records.folder / name).open("rb") as file:
        assert sum(1 for _ in make_reader(file, validate_crcs=True).iter_messages()) > 4
    assert played.status_code == 200, played.text
    assert kind == Kind.DISPARITY
    assert fresh.hub.desk.playback is not None


def test_a_recording_stands_still_moves_and_stays_where_the_camera_cannot_be_had_again(fresh: SmallViewer) -> None:
    name = fresh.post("record", {"on": True}).json()["tape"]["name"]
    for _ in range(4):
        fresh.send()
        time.sleep(0.05)
    refused = fresh.post("play", {"name": name})
    fresh.post("record", {"on": False})
    fresh.post("play", {"name": name, "position_s": 0.1})
    fresh.post("pause", {"on": True})
    fresh.post("play", {"name": name, "position_s": 0.05})
    shown = fresh.client.get("/api/state").json()["status"]["playback"]
    elsewhere = fresh.post("play", {"name": "../else.mcap"})
    gone = fresh.post("live", {})

    assert "is being made" in refused.json()["error"]
    assert (shown["name"], shown["paused"]) == (name, True)
    assert shown["position_s"] == pytest.approx(0.05, abs=0.06)
    assert elsewhere.status_code == 400
    assert gone.status_code == 503  # its link is closed for good
    assert fresh.hub.desk.playback is not None


def _comes(wanted: Any, timeout_s: float = 5.0) -> bool:
    deadline_s = time.monotonic() + timeout_s
    while time.monotonic() < deadline_s:
        if wanted():
            return True
        time.sleep(0.01)
    return False
