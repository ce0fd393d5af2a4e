"""The far end of the bench: the firmware's own service in a process of its own, with frames that the desk knows too.

Started with one JSON argument: `port`, `baud`, `width`, `height`, `rate_hz`, `bound` (null: rate control chooses), `boot_id`.
Answers one JSON line for each that it reads; it ends with its standard input.
"""

from __future__ import annotations

import json
import sys
import time

from prismstereo.link_bench.far_end_state import CountingSetting, MemoryObjects
from prismstereo.link_bench.judging import lens_position_of
from prismstereo.link_bench.numbered_maps import DIFFERENT, numbered_map
from prismstereo_device.link import open_link
from prismstereo_device.protocol import Capability
from prismstereo_device.serving.rate_control import RateControl
from prismstereo_device.serving.service import DeviceIdentity, Service
from prismstereo_device.source import ProducedFrame

__all__ = ["NumberedFrames", "main"]

_DEVICE_ID = b"linkbnch"


class NumberedFrames:
    """A source of numbered frames, `rate_hz` of them a second, stamped with the computer's monotonic clock."""

    def __init__(self, width: int, height: int, rate_hz: float) -> None:
        self._width, self._height = width, height
        self._period_s = 1.0 / rate_hz
        self._index = -1
        for number in range(DIFFERENT):
            numbered_map(number, width, height)
        self._due_s = time.monotonic()

    def read(self) -> ProducedFrame:
        """Make the next frame when it is due; one that is late makes the later ones late too."""
        wait_s = self._due_s - time.monotonic()
        if wait_s > 0:
            time.sleep(wait_s)
        self._due_s = max(self._due_s, time.monotonic() - self._period_s) + self._period_s
        self._index += 1
        disparity = numbered_map(self._index % DIFFERENT, self._width, self._height)
        stamp_us = time.monotonic_ns() // 1000
        return ProducedFrame(self._index, stamp_us, lens_position_of(self._index), disparity)


def main() -> None:
    """Serve until standard input ends."""
    wish = json.loads(sys.argv[1])
    source = NumberedFrames(wish["width"], wish["height"], wish["rate_hz"])
    setting, objects = CountingSetting(), MemoryObjects()
    with open_link(wish["port"], baud=wish["baud"]) as link:
        rate_control = RateControl(bound=wish["bound"], line_bytes_per_s=link.bytes_per_s)
        identity = DeviceIdentity(_DEVICE_ID, wish["boot_id"])
        service = Service(
            source,
            link,
            identity,
            objects=objects,
            commands=setting,
            rate_control=rate_control,
            offers=Capability.WRITE,
        )
        with service:
            _tell({"ready": True})
            for _ in sys.stdin:
                _tell({"sent": service.statistics.sent, "run_twice": setting.run_twice, "cpu_s": time.process_time()})


def _tell(line: dict[str, object]) -> None:
    sys.stdout.write(json.dumps(line) + "\n")
    sys.stdout.flush()


if __name__ == "__main__":
    main()
