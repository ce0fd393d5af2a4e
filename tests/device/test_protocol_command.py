"""Commands: strict JSON of a fixed form; an answer fits the smallest packet, and no text breaks a reader."""

from __future__ import annotations

import json
import tracemalloc

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from device.wire_scenes import quickest_s
from prismstereo_device.protocol import Command, CommandReply, CommandStatus
from prismstereo_device.wire import LIMITS, WireError

NUMBER = st.integers(-(2**53), 2**53)
VALUES = (
    st.none()
    | st.booleans()
    | NUMBER
    | st.floats(allow_nan=False, allow_infinity=False)
    | st.text(max_size=20)
    | st.lists(NUMBER, max_size=5)
)
NAMES = st.from_regex(r"[a-z][a-z0-9_]{0,31}", fullmatch=True)


@settings(deadline=None, max_examples=50)
@given(st.sampled_from(["get", "set", "do"]), NAMES, VALUES)
def test_a_command_comes_back(verb, name: str, value) -> None:
    command = Command(verb, name, value)
    assert Command.unpack(command.pack()) == command
    assert type(Command.unpack(command.pack()).value) is type(value)


@settings(deadline=None, max_examples=50)
@given(VALUES)
def test_the_value_of_an_answer_comes_back(value) -> None:
    reply = CommandReply(CommandStatus.OK, value)
    assert CommandReply.unpack(reply.pack()) == reply


def test_the_bodies_are_laid_out_as_the_wire_format_says() -> None:
    assert json.loads(Command("set", "gain", 2.5).pack()) == ["set", "gain", 2.5]
    assert CommandReply(CommandStatus.OK, 2.5).pack() == b"\x002.5"
    assert CommandReply(CommandStatus.REFUSED, why="gain").pack() == b'\x02"gain"'


def test_what_a_later_version_adds_to_a_command_is_ignored() -> None:
    assert Command.unpack(b'["get","gain",null,{"new":[1,2]},3]') == Command("get", "gain")
    assert Command.unpack(b'["get","gain"]') == Command("get", "gain")


@settings(deadline=None, max_examples=80)
@given(
    st.text(max_size=200) | st.sampled_from(["\0" * 300, '"' * 300, "\ud800" * 300, "ä" * 300, "x" * 300, "\n\t" * 99])
)
def test_any_sentence_fits_the_smallest_packet(why: str) -> None:
    body = CommandReply(CommandStatus.FAILED, why=why).pack()
    assert len(body) <= LIMITS.payload_min
    assert why.encode(errors="replace").decode().startswith(CommandReply.unpack(body).why)


def test_a_sentence_is_not_cut_before_it_has_to_be() -> None:
    assert len(CommandReply.unpack(CommandReply(CommandStatus.FAILED, why="x" * 300).pack()).why) == 125


@pytest.mark.parametrize(
    "body",
    [
        b"",
        b"null",
        b"{}",
        b'["get"]',
        b'["run","gain",1]',
        b'["get","Gain",1]',
        b'["get","gain\\n",1]',
        b'["get","",1]',
        b'["get","' + b"a" * 33 + b'",1]',
        b'["set","gain",NaN]',
        b'["set","gain",1e999]',
        b'["set","gain",1' + b"0" * 400 + b"]",
        b'["set","gain",9007199254740993]',
        b'["set","gain",{"a":1}]',
        b'["set","gain",[1.5]]',
        b'["set","gain","\\ud800"]',
        b'["set","gain","\xff"]',
        b'["set","gain",1] more',
        b'\xef\xbb\xbf["set","gain",1]',
    ],
)
def test_anything_else_is_no_command(body: bytes) -> None:
    with pytest.raises(WireError, match=r"is not \[verb, name, value\]"):
        Command.unpack(body)


@pytest.mark.parametrize("body", [b"", b"\x06null", b"\xffnull", b"\0", b"\0{}", b"\x01null", b"\x01[1]", b"\0NaN"])
def test_anything_else_is_no_answer(body: bytes) -> None:
    with pytest.raises(WireError):
        CommandReply.unpack(body)


def nested(before: bytes, depth: int) -> bytes:
    return before + b"[" * depth + b"]" * depth


@pytest.mark.parametrize(
    "body",
    [nested(b"", 100_000), nested(b'["set","gain",', 100_000) + b"]", nested(b'["set","gain",1,', 100_000) + b"]"],
)
def test_json_a_hundred_thousand_deep_is_refused_at_once(body: bytes) -> None:
    def refuse() -> None:
        with pytest.raises(WireError):
            Command.unpack(body)
        with pytest.raises(WireError):
            CommandReply.unpack(b"\0" + body)

    assert quickest_s(refuse, 0.05) < 0.05
    tracemalloc.start()
    try:
        refuse()
        _, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert peak < 16 << 20
