"""Runs a case: the firmware's service in one process, the bad line in another, the desk's camera here."""

from __future__ import annotations

import base64
import queue
import random
import threading
import time
from dataclasses import dataclass, field
from typing import Self

from prismstereo.driver import CameraFrame, StereoCamera
from prismstereo.link_bench.bench_case import BenchCase
from prismstereo.link_bench.bench_result import Arrival, BenchResult, recovery_s
from prismstereo.link_bench.child import Child
from prismstereo.link_bench.fault_line import FaultLine
from prismstereo.link_bench.fault_plan import FaultPlan
from prismstereo.link_bench.judging import FrameJudge
from prismstereo.requests import OutcomeUnknown
from prismstereo_device.serving.rate_control import HALVED
from prismstereo_hw.errors import PrismStereoError

__all__ = ["run_case"]

_FAR_END = "prismstereo.link_bench.far_end"
_OPEN_S = 15.0
_SETTLE_S = 0.5  # after the hello, before figures are taken
_COMMAND_PAUSE_S = 0.03
_TRANSFER_S = 10.0
_UNJUDGED = 64
_TIME_TO_RECOVER_S = 1.0  # a spell that ends so close to the end of the run is not judged
_COUNTS = ("sent", "run_twice", "cpu_s")


def run_case(case: BenchCase) -> BenchResult:
    """Run a case; it takes its seconds and some more. Raises DeviceError where the two ends do not even meet."""
    with FaultLine(case.faults, baud=case.baud, kind=case.kind, seed=case.seed) as line:
        far_end = _FarEnd(case, line)
        try:
            camera = StereoCamera.open(line.host_port, _OPEN_S, baud=_baud(case))
            with _Reader(camera, FrameJudge(case.width, case.height)) as reader:
                time.sleep(_SETTLE_S)
                return _measure(case, line, far_end, camera, reader)
        finally:
            far_end.stop()


def _baud(case: BenchCase) -> int | None:
    return case.baud if case.kind == "pty" else None


class _FarEnd:
    """The camera's process, which can be killed and started again; its counters go on over that."""

    def __init__(self, case: BenchCase, line: FaultLine) -> None:
        self._case, self._line = case, line
        self._boots = 0
        self._before = dict.fromkeys(_COUNTS, 0.0)
        self.restarted_at_s: float | None = None
        self._child = self._start()

    def _start(self) -> Child:
        self._boots += 1
        case = self._case
        wish: dict[str, object] = {"port": self._line.device_port, "baud": _baud(case), "boot_id": self._boots}
        frames = {"width": case.width, "height": case.height, "rate_hz": case.rate_hz, "bound": case.bound}
        return Child(_FAR_END, wish | frames)

    def counts(self) -> dict[str, float]:
        """Give its counters; raises DeviceError where it does not answer."""
        found = {name: float(str(value)) for name, value in self._child.ask({"do": "count"}).items()}
        return found | {name: found[name] + self._before[name] for name in _COUNTS}

    def reboot(self) -> None:
        """Kill it and start it again."""
        self._before = {name: count for name, count in self.counts().items() if name in _COUNTS}
        self._child.kill()
        self._child = self._start()
        self.restarted_at_s = time.monotonic()

    def stop(self) -> None:
        self._child.stop()


class _Reader:
    """Takes every frame as soon as it is there, in one thread, and holds it against what was sent, in another."""

    def __init__(self, camera: StereoCamera, judge: FrameJudge) -> None:
        self._camera, self._judge = camera, judge
        self.arrivals: list[Arrival] = []
        self.error: PrismStereoError | None = None
        self._unjudged: queue.Queue[tuple[float, CameraFrame] | None] = queue.Queue(_UNJUDGED)
        self._threads = [
            threading.Thread(target=work, name=f"bench{work.__name__}") for work in (self._take, self._hold_against)
        ]

    def _take(self) -> None:
        try:
            for frame in self._camera:
                self._unjudged.put((time.monotonic(), frame))
        except PrismStereoError as error:
            self.error = error
        finally:
            self._unjudged.put(None)

    def _hold_against(self) -> None:
        while (one := self._unjudged.get()) is not None:
            at_s, frame = one
            age_s = at_s - frame.timestamp_us / 1e6  # both ends have the same clock: one computer's
            halved = bool(frame.filter_set & HALVED)
            self.arrivals.append(Arrival(at_s, age_s, frame.partial, self._judge.judge(frame), frame.bound, halved))

    def __enter__(self) -> Self:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._camera.close()
        for thread in self._threads:
            thread.join()


@dataclass(slots=True)
class _Commands:
    """Sets a setting to one new value after the other, and notes how long each answer took."""

    taken_s: list[float] = field(default_factory=list)
    unknown: int = 0
    failed: int = 0
    asked: int = 0

    def ask(self, camera: StereoCamera) -> None:
        self.asked += 1
        begun_s = time.monotonic()
        try:
            if camera.set("exposure_us", self.asked) == self.asked:
                self.taken_s.append(time.monotonic() - begun_s)
            else:
                self.failed += 1
        except OutcomeUnknown:
            self.unknown += 1
        except PrismStereoError:
            self.failed += 1


def _measure(case: BenchCase, line: FaultLine, far_end: _FarEnd, camera: StereoCamera, reader: _Reader) -> BenchResult:
    before, begun_s = far_end.counts(), time.monotonic()
    commands = _Commands()
    reboot = threading.Thread(target=far_end.reboot, name="bench-reboot") if case.reboot else None
    while (passed_s := time.monotonic() - begun_s) < case.seconds:
        if reboot is not None and reboot.ident is None and passed_s > case.seconds / 2:
            reboot.start()
        commands.ask(camera)
        time.sleep(_COMMAND_PAUSE_S)
    if reboot is not None:
        reboot.join()
    ended_s = time.monotonic()
    after = far_end.counts()
    transfer = _Transfer(camera, _content(case))
    transfer.run()
    if reader.error is not None:
        raise reader.error
    ends_s = _spell_ends(case, line, begun_s, ended_s)
    if far_end.restarted_at_s is not None:
        ends_s.append(far_end.restarted_at_s)
    return BenchResult(
        arrivals=tuple(one for one in reader.arrivals if begun_s <= one.at_s < ended_s),
        seconds=ended_s - begun_s,
        sent_frames=round(after["sent"] - before["sent"]),
        command_s=tuple(commands.taken_s),
        commands_unknown=commands.unknown,
        commands_failed=commands.failed,
        run_twice=round(after["run_twice"]),
        recovery_s=recovery_s([*reader.arrivals], ends_s),
        upload_s=transfer.upload_s,
        download_s=transfer.download_s,
        transfer_bytes=case.transfer_bytes,
        transfer_wrong=transfer.came_back_wrong,
        sessions=camera.statistics.sessions,
        far_end_cpu_percent=100 * (after["cpu_s"] - before["cpu_s"]) / (ended_s - begun_s),
    )


def _content(case: BenchCase) -> str:
    return base64.b85encode(
        random.Random(case.seed).randbytes(case.transfer_bytes * 4 // 5)
    ).decode()  # what a log may hold


class _Transfer:
    """Sends an object, has it committed, and fetches it back, beside the frames; times are None where it takes too long."""

    def __init__(self, camera: StereoCamera, content: str) -> None:
        self._camera, self._content = camera, content
        self.upload_s: float | None = None
        self.download_s: float | None = None
        self.came_back_wrong = False
        self._thread = threading.Thread(target=self._work, name="bench-transfer")

    def run(self) -> None:
        """Wait for it as long as is sensible; closing the camera ends it."""
        self._thread.start()
        self._thread.join(_TRANSFER_S)
        if self._thread.is_alive():
            self._camera.close()
            self._thread.join()

    def _work(self) -> None:
        try:
            begun_s = time.monotonic()
            self._camera.send_update(self._content.encode())
            sent_s = time.monotonic()
            self.upload_s = sent_s - begun_s
            received = self._camera.log()
        except PrismStereoError:
            return
        self.came_back_wrong = received != self._content
        self.download_s = time.monotonic() - sent_s


def _spell_ends(case: BenchCase, line: FaultLine, begun_s: float, ended_s: float) -> list[float]:
    """Give the moments of the run at which a spell of faults ended."""
    last_s = ended_s - _TIME_TO_RECOVER_S
    ends_s = []
    for spell in FaultPlan.parse(case.faults).spells:
        at_s = line.since_s + spell.period_s
        while at_s <= last_s:
            if at_s - spell.duration_s >= begun_s:
                ends_s.append(at_s)
            at_s += spell.period_s
    return ends_s
