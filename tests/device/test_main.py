"""The program: from a command line to a camera that answers, remembers, and ends as it says."""

from __future__ import annotations

import dataclasses
import json
import os
import signal
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from hashlib import sha256
from pathlib import Path

import msgspec
import pytest

from device.service_host import Host
from device.small_camera import plain_calibration, plain_rig
from prismstereo_calibration import flash
from prismstereo_device.__main__ import REBOOT, main
from prismstereo_device.link import open_link
from prismstereo_device.objects import ObjectNumber, WriteStatus
from prismstereo_device.protocol import Capability, HelloReply, ReadReply, ReadRequest
from prismstereo_device.protocol.bulk import WriteBegin, WriteCommit, WritePart, WriteReply
from prismstereo_device.protocol.command import Command, CommandReply, CommandStatus, Value, Verb
from prismstereo_device.wire import Channel


class Desk(Host):
    """A host that gives commands and moves objects, one request after the other."""

    asked = 0

    def command(self, verb: Verb, name: str, value: Value = None) -> CommandReply:
        self.asked += 1
        return CommandReply.unpack(self.ask(Channel.CMD, Command(verb, name, value).pack(), self.asked))

    def read(self, obj: int) -> bytes:
        content, total = b"", 1
        while len(content) < total:
            self.asked += 1
            body = ReadRequest(obj, 0, len(content), 4096).pack()
            part = ReadReply.unpack(self.ask(Channel.BULK, body, self.asked))
            content, total = content + part.data, part.total
        return content

    def write(self, obj: int, content: bytes) -> WriteReply:
        name, step = sha256(content).digest(), 2000
        parts = [WritePart(obj, name[:4], at, content[at : at + step]).pack() for at in range(0, len(content), step)]
        for body in (WriteBegin(obj, len(content), name).pack(), *parts, WriteCommit(obj, len(content), name).pack()):
            self.asked += 1
            reply = WriteReply.unpack(self.ask(Channel.BULK, body, self.asked))
            assert reply.status is WriteStatus.OK, reply.why
        return reply


@pytest.fixture
def rig_file(tmp_path: Path) -> Path:
    path = tmp_path / "plain.toml"
    rig = plain_rig()
    still = msgspec.structs.replace(rig.camera.still, width=640, height=480)
    path.write_text(msgspec.structs.replace(rig, camera=msgspec.structs.replace(rig.camera, still=still)).toml())
    return path


def served(arguments: list[str], port: Path, talk: Callable[[Desk, HelloReply], None]) -> int:
    """Run the program in this thread, and a host that talks to it in another; give the exit code."""

    def visit() -> None:
        try:
            until_s = time.monotonic() + 60
            while not port.exists():
                assert time.monotonic() < until_s, "the program opened no port"
                time.sleep(0.01)
            with open_link(str(port)) as link:
                desk = Desk(link)
                talk(desk, desk.meet())
        except BaseException:
            os.kill(os.getpid(), signal.SIGTERM)  # or the program would go on
            raise

    before = signal.signal(signal.SIGTERM, signal.SIG_IGN)  # one that comes after the program's end is for nobody
    try:
        with ThreadPoolExecutor(1) as host:
            visited = host.submit(visit)
            try:
                main([*arguments, "--matcher", "bm", "--link", "pty", "--symlink", str(port)])
            except SystemExit as ended:
                visited.result(60)
                return int(ended.code or 0)
            visited.result(60)
        return 0
    finally:
        signal.signal(signal.SIGTERM, before)


def test_a_camera_takes_commands_and_starts_again_with_what_it_was_given(
    tmp_path: Path, rig_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["--sensor", f"twin:{rig_file}:plane:600", "--state", str(tmp_path / "state"), "--rate", "60"]
    known: list[HelloReply] = []
    written = flash.pack(dataclasses.replace(flash.unpack(plain_calibration()), rms_px=0.125))

    def first(desk: Desk, met: HelloReply) -> None:
        known.append(met)
        assert met.capabilities >= Capability.COMMANDS | Capability.WRITE | Capability.STILL | Capability.ZONES
        assert met.calibration_hash == flash.digest(plain_calibration())
        assert desk.command("set", "gain", 2.0) == CommandReply(CommandStatus.OK, 2.0)
        assert desk.command("do", "still", [1, 0, 0, 64, 48]).status is CommandStatus.OK
        desk.write(ObjectNumber.CALIBRATION, written)
        assert desk.read(ObjectNumber.CALIBRATION) == desk.read(ObjectNumber.FACTORY_CALIBRATION) == written
        assert desk.command("do", "self_test").status is CommandStatus.OK
        until_s = time.monotonic() + 20
        while '"ready"' not in str(desk.command("get", "still").value):
            assert time.monotonic() < until_s
        assert desk.read(ObjectNumber.STILL).startswith(b"\x89PNG")
        assert b"session 1 begins" in desk.read(ObjectNumber.LOG)
        assert desk.command("do", "reboot").status is CommandStatus.OK

    def second(desk: Desk, met: HelloReply) -> None:
        assert (met.device_id, met.calibration_hash) == (known[0].device_id, flash.digest(written))
        assert met.boot_id != known[0].boot_id
        identity = json.loads(desk.read(ObjectNumber.IDENTITY))
        assert identity["device_id"] == met.device_id.hex()
        assert identity["rig"] == "wedge"
        assert desk.command("get", "boot_id").value == met.boot_id
        os.kill(os.getpid(), signal.SIGTERM)

    assert served(arguments, tmp_path / "port", first) == REBOOT == 75
    assert served(arguments, tmp_path / "port", second) == 0
    lines = [json.loads(line) for line in capsys.readouterr().out.splitlines()]
    assert [next(iter(line)) for line in lines] == ["listening", "statistics"] * 2
    assert lines[1]["statistics"]["sessions"] == 1


def test_check_says_what_would_run_and_opens_nothing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "device.toml"
    path.write_text('sensor = "url:rtsp://eve:secret@camera/1"\nfilters = "robot"\nlink = "/dev/no-such-port"\n')
    main(["--config", str(path), "--check", "--state", str(tmp_path / "state")])
    said = capsys.readouterr().out
    told = json.loads(said)
    assert told["configuration"]["link"] == "/dev/no-such-port"
    assert told["state"] == str(tmp_path / "state")
    assert told["filters"] > 0
    assert "secret" not in said
    assert not (tmp_path / "state").exists()


@pytest.mark.parametrize(
    ("arguments", "code", "words"),
    [
        ([], 2, "no sensor is given: say --sensor KIND:..."),
        (["--config", "/no/such/file"], 2, "there is no configuration '/no/such/file'"),
        (["--sensor", "radar:1"], 2, "there is no sensor 'radar:'"),
        (["--sensor", "twin:{rig}", "--matcher", "magic"], 2, "there is no matcher 'magic'"),
        (["--sensor", "twin:{rig}", "--link", "tcp:nowhere"], 2, "give tcp:HOST:PORT"),
        (["--sensor", "twin:{rig}", "--rate", "2000"], 2, "rate_hz 2000.0: give a number from 0.1 to 1000 Hz"),
        (["--sensor", "twin:{rig}", "--link", "/dev/no-such-port"], 3, "/dev/no-such-port"),
        (["--sensor", "oak:?mode=stereo&rig=oak-1"], 2, "give --state DIR"),
        (["--sensor", "replay:/no/such/folder"], 4, "there is nothing to replay"),
        (["--sensor", "twin:{rig}", "--calibration", "{rig}"], 4, "flash begins with"),
        (["--check", "--sensor", "twin:oak-1", "--filters", "fog"], 2, "there are no filters 'fog'"),
        (
            ["--check", "--sensor", "twin:oak-1", "--calibration", "none.json"],
            2,
            "cannot read the calibration none.json",
        ),
        (["--check", "--sensor", "twin:oak-1", "--matcher", "magic"], 2, "there is no matcher 'magic'"),
    ],
)
def test_what_cannot_start_ends_with_one_sentence_and_its_code(
    arguments: list[str], code: int, words: str, rig_file: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main([argument.format(rig=rig_file) for argument in arguments])
    assert ended.value.code == code
    *_, said = capsys.readouterr().err.strip().splitlines()
    assert said.startswith("error: ")
    assert words in said


def test_the_help_teaches_by_example(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["--help"])
    said = capsys.readouterr().out
    assert ended.value.code == 0
    for words in ("--config", "--check", "--state", "twin:oak-1", "exit codes: 0", "75 a host asked for a restart"):
        assert words in said
