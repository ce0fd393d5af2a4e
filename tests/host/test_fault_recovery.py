from __future__ import annotations

import contextlib
import os
import random
import threading
import time
from collections.abc import Iterator

import pytest

from host.faulty_line import BAUD, STRIPES, Watch, eventually, watched
from prismstereo.driver import StereoCamera
from prismstereo.requests import OutcomeUnknown
from prismstereo_hw.errors import DeviceError


@pytest.fixture(scope="module")
def both_ends() -> Iterator[Watch]:
    with watched() as watch:
        yield watch


@pytest.fixture
def watch(both_ends: Watch) -> Watch:
    """Both ends of a clean line, with frames arriving."""
    both_ends.calm()
    return both_ends


@pytest.mark.parametrize("faults", ["flips=1e-4,drops=1e-4", "chunkdrop=0.02,garbage=0.02", "bits=1e-3"])
def test_whatever_the_line_does_no_wrong_stripe_is_taken_for_right(watch: Watch, faults: str) -> None:
    bad = watch.camera.statistics.line.bad
    watch.line.set_faults(faults)
    assert eventually(lambda: watch.camera.statistics.line.bad >= bad + 5)
    watch.line.set_faults("")
    watch.frames_from(time.monotonic(), 2)
    assert watch.right >= STRIPES
    assert watch.wrong == 0


def test_one_flipped_byte_in_ten_thousand_leaves_85_percent_of_the_stripes(watch: Watch) -> None:
    sent = watch.service.statistics.sent
    watch.line.set_faults("flips=1e-4")
    watch.frames_from(watch.line.since_s, 15)
    sent = watch.service.statistics.sent - sent
    assert watch.right >= 0.85 * STRIPES * (sent - 2)  # the first and the last may be on their way
    assert watch.wrong == 0


@pytest.mark.parametrize(("faults", "seconds"), [("drops=1", 0.4), ("flips=1", 0.2)])
def test_frames_come_again_soon_after_a_dead_line_or_a_wrong_speed(watch: Watch, faults: str, seconds: float) -> None:
    watch.line.set_faults(faults)
    time.sleep(seconds)
    watch.line.set_faults("")
    back_s = watch.line.since_s
    first = watch.frames_from(back_s, 3)[0]
    assert watch.wrong == 0
    assert first.at_s - back_s < 2.0  # a generous limit for two busy cores; without load it is a tenth of that


def test_after_a_stall_the_newest_frame_wins(watch: Watch) -> None:
    dropped = watch.service.statistics.dropped
    watch.line.set_faults("stall=0.4/0.6")
    after_stall = watch.frames_from(watch.line.since_s + 0.61, 3)
    assert max(arrival.age_s for arrival in after_stall) < 0.4 + 0.6  # no queue of old frames: there were ten meanwhile
    assert watch.service.statistics.dropped > dropped
    assert watch.wrong == 0


def test_replugged_again_and_again_it_comes_back_and_leaks_nothing(watch: Watch) -> None:
    before = len(os.listdir("/dev/fd")), threading.active_count()
    begun = watch.camera.statistics.replugs
    for number in range(1, 4):
        watch.line.replug()
        assert eventually(lambda number=number: watch.camera.statistics.replugs == begun + number)
        watch.frames_from(time.monotonic(), 1)
    assert (len(os.listdir("/dev/fd")), threading.active_count()) == before
    assert watch.wrong == 0


def test_no_command_is_run_twice_on_a_line_that_loses_and_doubles(watch: Watch) -> None:
    watch.line.set_faults("chunkdrop=0.1,dups=2e-3")
    known = 0
    for value in range(100, 110):
        with contextlib.suppress(OutcomeUnknown):
            assert watch.camera.set("exposure_us", value) == value
            known += 1
    assert known >= 5
    assert watch.setting.run_twice == 0


def test_a_command_cut_by_a_replug_is_run_once_or_not_at_all(watch: Watch) -> None:
    outcomes: list[object] = []

    def ask() -> None:
        try:
            outcomes.append(watch.camera.set("exposure_us", 99))
        except DeviceError as error:
            outcomes.append(error)

    repeated = watch.camera.statistics.repeated
    watch.line.set_faults("down:drops=1")  # the command arrives, its answer does not
    asking = threading.Thread(target=ask)
    asking.start()
    assert eventually(lambda: watch.camera.statistics.repeated > repeated)
    watch.line.replug()
    watch.line.set_faults("")
    asking.join()
    assert watch.setting.run_twice == 0
    assert watch.camera.get("exposure_us") == 99
    assert outcomes == [99] or isinstance(outcomes[0], OutcomeUnknown)


def test_an_upload_goes_on_where_a_replug_cut_it_and_is_committed_whole(watch: Watch) -> None:
    content = random.Random(6).randbytes(20_000).hex()
    watch.line.set_faults("chunkdrop=0.02")
    sending = threading.Thread(target=watch.camera.send_update, args=(content.encode(),))
    sending.start()
    assert eventually(lambda: watch.objects.held_bytes > 5_000)
    watch.line.replug()
    sending.join(20.0)
    assert watch.camera.log() == content
    assert watch.objects.commits == 1


def test_a_host_that_vanished_makes_room_for_the_next() -> None:
    with watched(rate_hz=10.0) as watch:
        watch.camera.close()  # says no farewell: as if it were killed
        with StereoCamera.open(watch.line.host_port, baud=BAUD) as next_one:
            assert next(iter(next_one)).index > 0
        assert watch.service.statistics.sessions == 2
