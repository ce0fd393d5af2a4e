from __future__ import annotations

from prismstereo_device.protocol import FrameAck
from prismstereo_device.serving.session import Session


def test_a_session_ends_in_silence_and_forgives_frames_that_were_lost_on_the_line() -> None:
    session = Session(5, now_s=100.0)
    for frame in (7, 8, 9):
        assert session.may_stream(100.0)
        session.begin_frame(frame)
        session.end_frame(100.0)
    assert not session.may_stream(100.1)
    session.acknowledge(FrameAck(7))
    assert session.may_stream(100.1)
    session.begin_frame(10)
    session.end_frame(100.2)
    session.acknowledge(FrameAck(7))  # the host repeats itself: 8, 9 and 10 are still out
    assert not session.may_stream(101.0)
    assert not session.may_stream(102.0)  # nothing heard since: it may be the host that is gone
    session.hear(101.9)
    assert session.may_stream(102.0)
    assert session.alive(104.8)
    assert not session.alive(104.9)
    assert not session.may_stream(105.0)


def test_a_session_with_nobody_is_never_alive() -> None:
    assert not Session(0, now_s=100.0).may_stream(100.0)


def test_frames_are_forgotten_across_the_wrap_of_their_number() -> None:
    session = Session(5, now_s=100.0)
    for frame in (0xFFFF_FFFE, 0xFFFF_FFFF, 0):
        session.begin_frame(frame)
    assert not session.may_stream(100.1)
    session.acknowledge(FrameAck(0))
    for frame in (1, 2, 3):
        assert session.may_stream(100.1)
        session.begin_frame(frame)
    assert not session.may_stream(100.1)


def test_a_host_that_asks_to_wait_is_alive_and_not_listening() -> None:
    session = Session(5, now_s=100.0)
    session.acknowledge(FrameAck(0, room=0))
    assert session.alive(100.1)
    assert not session.listening(100.1)


def test_packets_get_short_and_heads_double_on_a_line_that_damages_them() -> None:
    session = Session(5, now_s=100.0)
    assert (session.lossy, session.video_mtu(1024)) == (False, 1024)
    session.acknowledge(FrameAck(0, loss_permille=1))
    assert not session.lossy
    session.acknowledge(FrameAck(0, loss_permille=2))
    assert (session.lossy, session.video_mtu(1024)) == (True, 1024)
    session.acknowledge(FrameAck(0, loss_permille=51))
    assert (session.video_mtu(1024), session.video_mtu(128)) == (240, 128)
