from __future__ import annotations

import logging
import threading
from collections.abc import Iterator

import pytest

from prismstereo_device.serving.log_ring import LogRing
from prismstereo_hw.errors import DeviceError


@pytest.fixture
def logger() -> Iterator[tuple[logging.Logger, LogRing]]:
    logger, ring = logging.getLogger("prismstereo_device.test_log_ring"), LogRing(most_bytes=2000)
    logger.setLevel(logging.DEBUG)
    logger.propagate = False
    logger.addHandler(ring)
    yield logger, ring
    logger.removeHandler(ring)
    ring.close()


def test_lines_come_back_oldest_first_with_time_and_level(logger: tuple[logging.Logger, LogRing]) -> None:
    log, ring = logger
    log.info("session %d begins", 1)
    log.warning("no lamp")
    log.debug("not worth keeping")
    first, second = ring.content().decode().splitlines()
    assert first.endswith("INFO prismstereo_device.test_log_ring: session 1 begins")
    assert second.endswith("WARNING prismstereo_device.test_log_ring: no lamp")
    assert ring.last_error == ""


def test_it_never_grows_beyond_its_bytes_and_keeps_the_newest(logger: tuple[logging.Logger, LogRing]) -> None:
    log, ring = logger
    for number in range(500):
        log.info("line %d with some words", number)
    content = ring.content()
    assert len(content) <= 2000
    assert content.decode().splitlines()[-1].endswith("line 499 with some words")


def test_a_line_as_long_as_a_book_is_cut(logger: tuple[logging.Logger, LogRing]) -> None:
    log, ring = logger
    log.info("x" * 1_000_000)
    assert len(ring.content()) <= 2048


def test_the_last_error_is_one_line_with_what_was_raised(logger: tuple[logging.Logger, LogRing]) -> None:
    log, ring = logger
    log.error("the source failed after %d frames", 7, exc_info=DeviceError("the sensor\nwas pulled out"))
    log.info("on it goes")
    assert ring.last_error == "the source failed after 7 frames: the sensor was pulled out"
    assert len(ring.content().decode().splitlines()) == 2


def test_bytes_that_are_no_text_do_not_break_it(logger: tuple[logging.Logger, LogRing]) -> None:
    _, ring = logger  # handed to the ring alone: whatever else listens to logs need not bear such a name
    ring.handle(logging.LogRecord("names", logging.ERROR, __file__, 1, "a name: %s", ("caf\udce9",), None))
    assert "caf?" in ring.content().decode()


def test_it_is_read_while_others_write(logger: tuple[logging.Logger, LogRing]) -> None:
    log, ring = logger
    writers = [threading.Thread(target=lambda: [log.info("n %d", n) for n in range(300)]) for _ in range(3)]
    for writer in writers:
        writer.start()
    sizes = [len(ring.content()) for _ in range(100)]
    for writer in writers:
        writer.join()
    assert max(sizes) <= 2000
    assert all(" INFO " in line for line in ring.content().decode().splitlines())
