"""Network cameras: a real MJPEG server on loopback, decoded by the FFmpeg in OpenCV."""

from __future__ import annotations

import http.server
import socket
import threading
import time
from collections.abc import Callable, Iterator

import cv2
import numpy as np
import pytest

from prismstereo_device.sensors import open_sensor
from prismstereo_device.sensors.base import Exposure, StampQuality
from prismstereo_device.sensors.url import UrlSensor
from prismstereo_hw.errors import DeviceError, UsageError
from prismstereo_hw.rig import Rig


class MjpegServer(http.server.ThreadingHTTPServer):
    """Streams pictures of which the n-th has its left 4 n columns white, `period_s` apart, until it is told to die."""

    daemon_threads = True

    def __init__(self, period_s: float) -> None:
        super().__init__(("127.0.0.1", 0), _Streaming)
        self.period_s, self.dying, self.sent = period_s, threading.Event(), 0
        self.asked: list[tuple[str, str | None]] = []
        self.serving = threading.Thread(target=self.serve_forever, args=(0.02,))
        self.serving.start()

    def close(self) -> None:
        self.dying.set()
        self.shutdown()
        self.serving.join()
        self.server_close()

    def handle_error(self, request: object, client_address: object) -> None:
        """Say nothing of a client that hung up."""


class _Streaming(http.server.BaseHTTPRequestHandler):
    server: MjpegServer

    def log_message(self, *values: object) -> None:
        """Say nothing."""

    def do_GET(self) -> None:
        self.server.asked.append((self.path, self.headers.get("Authorization")))
        if self.path == "/missing":
            self.send_error(404)
            return
        if self.path == "/guarded" and self.headers.get("Authorization") != "Basic dXNlcjpzZWNyZXQ=":  # user:secret
            self.send_response(401)
            self.send_header("WWW-Authenticate", 'Basic realm="camera"')
            self.end_headers()
            return
        self.send_response(200)
        self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
        self.end_headers()
        n = 0
        while not self.server.dying.wait(self.server.period_s):
            picture = np.zeros((120, 160, 3), np.uint8)
            picture[:, : 4 * (n % 40)] = 255
            jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
            self.wfile.write(b"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: %d\r\n\r\n" % len(jpeg))
            self.wfile.write(jpeg + b"\r\n")
            n += 1
            self.server.sent = n


@pytest.fixture
def server() -> Iterator[MjpegServer]:
    made = MjpegServer(period_s=0.02)
    yield made
    made.close()


def white_columns(pixels: np.ndarray[tuple[int, ...], np.dtype[np.uint8]]) -> int:
    grey = pixels if pixels.ndim == 2 else pixels[:, :, 0]
    return int((grey[60] > 127).sum())


def test_frames_of_a_network_camera_come_in_order_with_the_time_of_their_arrival(server: MjpegServer, oak: Rig) -> None:
    sensor = open_sensor(f"url:http://127.0.0.1:{server.server_port}/video?size=small#rig=oak-1", frames=4)
    begin_us = time.monotonic_ns() // 1000
    frames = [frame for frame in iter(sensor.read, None) if frame is not None]
    end_us = time.monotonic_ns() // 1000
    sensor.close()
    assert server.asked == [("/video?size=small", None)]
    assert sensor.rig == oak
    assert sensor.stamp_quality is StampQuality.ARRIVAL
    assert len(frames) == 4
    stamps = [frame.timestamp_us for frame in frames]
    assert begin_us - 1_000_000 < stamps[0] < stamps[1] < stamps[2] < stamps[3] <= end_us
    for frame in frames:
        assert frame.pixels.shape == (120, 160, 3)
        assert abs(white_columns(frame.pixels) - 4 * (frame.index % 40)) <= 1  # the picture says its own number


def test_a_slow_reader_gets_the_newest_frame(server: MjpegServer) -> None:
    sensor = open_sensor(f"url:http://127.0.0.1:{server.server_port}/#colour=0")
    first = sensor.read()
    time.sleep(0.4)
    sent = server.sent
    second = sensor.read()
    sensor.close()
    assert first is not None
    assert second is not None
    assert second.pixels.shape == (120, 160)
    assert second.index >= sent - 10  # some buffers of the network, not all the twenty frames
    assert second.index - first.index >= 5


def test_a_server_that_dies_is_a_camera_that_went_away(server: MjpegServer) -> None:
    sensor = open_sensor(f"url:http://127.0.0.1:{server.server_port}/#timeout_s=2")
    assert sensor.read() is not None
    server.dying.set()
    begin_s = time.monotonic()
    with pytest.raises(DeviceError, match=rf"http://127\.0\.0\.1:{server.server_port} stopped giving frames"):
        list(iter(sensor.read, None))
    assert time.monotonic() - begin_s < 4
    sensor.close()


def test_a_server_that_falls_silent_is_not_waited_for_for_ever() -> None:
    with socket.create_server(("127.0.0.1", 0)) as silent:
        begin_s = time.monotonic()
        with pytest.raises(DeviceError, match=r"no stream from http://127\.0\.0\.1:\d+ within 0\.3 s"):
            open_sensor(f"url:http://127.0.0.1:{silent.getsockname()[1]}/#timeout_s=0.3")
        assert time.monotonic() - begin_s < 3


@pytest.mark.parametrize("scheme", ["http", "rtsp"])
def test_passwords_are_said_nowhere(
    scheme: str, capfd: pytest.CaptureFixture[str], caplog: pytest.LogCaptureFixture
) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
    address = f"{scheme}://hidden:secret@127.0.0.1:{port}/user=hidden_password=secret?token=secret"
    with pytest.raises(DeviceError, match=rf"no stream from {scheme}://127\.0\.0\.1:{port} within") as caught:
        open_sensor(f"url:{address}#timeout_s=1")
    told = "".join([str(caught.value), *capfd.readouterr(), caplog.text])
    assert "secret" not in told
    assert "hidden" not in told


def test_a_password_goes_to_the_camera_only(server: MjpegServer, capfd: pytest.CaptureFixture[str]) -> None:
    sensor = open_sensor(f"url:http://user:secret@127.0.0.1:{server.server_port}/guarded")
    assert sensor.read() is not None
    sensor.close()
    with pytest.raises(
        DeviceError, match=r"no stream from http://127\.0\.0\.1:\d+ within 2 s: check address, path, user"
    ):
        open_sensor(f"url:http://user:secreter@127.0.0.1:{server.server_port}/guarded#timeout_s=2")
    assert "secret" not in "".join(capfd.readouterr())


def test_a_wrong_path_is_an_error(server: MjpegServer) -> None:
    with pytest.raises(DeviceError, match=r"no stream from http://127\.0\.0\.1:\d+ within 2 s: check address, path"):
        open_sensor(f"url:http://127.0.0.1:{server.server_port}/missing#timeout_s=2")


@pytest.mark.parametrize(
    ("address", "complaint"),
    [
        ("file:///etc/hostname", r"a network camera at file://: give an address with a host, that begins with rtsp://"),
        ("concat:a|b", "a network camera at concat://"),
        ("192.168.1.20/video", "a network camera at no://"),
        ("http://", "a network camera at http://"),
        ("http://[::1/video", "the address of the network camera cannot be read"),
        ("http://host:port/", "the address of the network camera cannot be read"),
        ("rtsp://host/#width=3", "there is no option 'width' of this sensor: give colour, rig, timeout_s"),
    ],
)
def test_an_address_that_is_none_is_refused(address: str, complaint: str) -> None:
    with pytest.raises(UsageError, match=complaint):
        UrlSensor.parse(address)


@pytest.mark.parametrize(
    "wish",
    [
        lambda sensor: sensor.set_exposure(Exposure(1000.0)),
        lambda sensor: sensor.set_rate(10.0),
        lambda sensor: sensor.set_lens(3),
        lambda sensor: sensor.still(),
    ],
)
def test_nothing_of_a_network_camera_can_be_set(server: MjpegServer, wish: Callable[[UrlSensor], None]) -> None:
    sensor = UrlSensor.parse(f"http://127.0.0.1:{server.server_port}/")
    with pytest.raises(UsageError):
        wish(sensor)
    sensor.close()
