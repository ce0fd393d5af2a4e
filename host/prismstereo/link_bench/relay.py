"""The relay: a process between two ends of a line, which does to the bytes what a plan says.

Started by `FaultLine` with one JSON argument. Prints where the two ends are, then answers one JSON line for each that it
reads: {"do": "faults", "plan": TEXT}, {"do": "unplug"}, {"do": "plug"}, {"do": "count"}. It ends with its standard input.
"""

from __future__ import annotations

import json
import os
import select
import sys
import time
from pathlib import Path

from prismstereo.link_bench.fault_plan import FaultPlan
from prismstereo.link_bench.lane import Lane
from prismstereo.link_bench.line_end import LineEnd, PtyEnd, TcpEnd

__all__ = ["Relay", "main"]

_LONGEST_WAIT_S = 0.01  # spells begin and end at any time
_STDIN = 0


class Relay:
    """Carries bytes between the camera's end and the host's until its standard input ends."""

    def __init__(self, device: LineEnd, host: LineEnd, plan: FaultPlan, seed: int) -> None:
        self._device, self._host = device, host
        self._seed = seed
        self._commands = bytearray()
        self._pulled = False
        self._take(plan)

    def _take(self, plan: FaultPlan) -> None:
        """Set the line up anew; what was on its way is lost."""
        self._plan = plan
        self._since_s = time.monotonic()
        self._up, self._down = Lane(plan.up, 2 * self._seed), Lane(plan.down, 2 * self._seed + 1)

    def run(self) -> None:
        """Carry bytes; returns when standard input ends."""
        self._tell({"device": self._device.address, "host": self._host.address, "since_s": self._since_s})
        while True:
            self._plug_or_unplug()
            now_s = time.monotonic() - self._since_s
            ways = (self._device, self._down, self._host), (self._host, self._up, self._device)
            for source, lane, sink in ways:
                self._carry(source, lane, sink, now_s)
            if not self._wait(ways, now_s):
                return

    def _carry(self, source: LineEnd, lane: Lane, sink: LineEnd, now_s: float) -> None:
        if (room := lane.room) and (data := source.read(room)):
            lane.put(data, now_s)
        if data := lane.out(now_s):
            lane.taken(sink.write(data))

    def _wait(self, ways: tuple[tuple[LineEnd, Lane, LineEnd], ...], now_s: float) -> bool:
        """Sleep until there is something to do; False when standard input has ended."""
        reading, writing, wait_s = [_STDIN], [], _LONGEST_WAIT_S
        for source, lane, sink in ways:
            bytes_at, newcomer_at = source.descriptors()
            if newcomer_at is not None:
                reading.append(newcomer_at)
            if bytes_at is not None and lane.room:
                reading.append(bytes_at)
            sink_at, _ = sink.descriptors()
            if sink_at is not None and lane.out(now_s):
                writing.append(sink_at)
            due_s = lane.due_in_s(now_s)
            if due_s is not None and not lane.halted(now_s):
                wait_s = min(wait_s, due_s)
        ready, _, _ = select.select(reading, writing, [], wait_s)
        for source, _, _ in ways:
            if source.descriptors()[1] in ready:
                source.welcome()
        return _STDIN not in ready or self._obey()

    def _plug_or_unplug(self) -> None:
        spell = self._plan.down.replug
        out = spell is not None and spell.active(time.monotonic() - self._since_s)
        if out != self._pulled:
            self._pulled = out
            if out:
                self._host.unplug()
            else:
                self._host.plug()

    def _obey(self) -> bool:
        data = os.read(_STDIN, 65536)
        self._commands += data
        while b"\n" in self._commands:
            line, _, rest = bytes(self._commands).partition(b"\n")
            self._commands[:] = rest
            self._do(json.loads(line))
        return bool(data)

    def _do(self, command: dict[str, str]) -> None:
        match command["do"]:
            case "faults":
                self._take(FaultPlan.parse(command["plan"]))
            case "unplug":
                self._host.unplug()
            case "plug":
                self._host.plug()
        carried = {"up_bytes": self._up.carried_bytes, "down_bytes": self._down.carried_bytes}
        self._tell({"since_s": self._since_s, **carried})

    def _tell(self, line: dict[str, object]) -> None:
        sys.stdout.write(json.dumps(line) + "\n")
        sys.stdout.flush()


def main() -> None:
    """Set up the two ends that the one argument describes and run."""
    wish = json.loads(sys.argv[1])
    folder = Path(wish["folder"])
    device: LineEnd = PtyEnd(folder / "device") if wish["kind"] == "pty" else TcpEnd()
    host: LineEnd = PtyEnd(folder / "host") if wish["kind"] == "pty" else TcpEnd()
    try:
        Relay(device, host, FaultPlan.parse(wish["plan"]), wish["seed"]).run()
    finally:
        device.unplug()
        host.unplug()


if __name__ == "__main__":
    main()
