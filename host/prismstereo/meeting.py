"""The host's half of hello: offer until the device accepts, refuses, or the time is over."""

from __future__ import annotations

import secrets
import threading
import time
from dataclasses import dataclass

from prismstereo_device.framing import Deframer, Framer, Packet
from prismstereo_device.link import Link, LinkLost
from prismstereo_device.protocol import Capability, Hello, HelloKind, HelloReply, read_hello
from prismstereo_device.wire import VERSION_MAX, VERSION_MIN, Channel, WireError
from prismstereo_hw.errors import DeviceError

__all__ = ["CameraIdentity", "Meeting", "answer_to", "meet", "offer"]

_OFFER_EVERY_S = 0.25
_POLL_S = 0.05


@dataclass(frozen=True, slots=True)
class CameraIdentity:
    """Who answered, and in which terms.

    `device_id` has 8 bytes and is for life, `boot_id` is drawn at each start, `calibration_hash` is zeros where the
    camera has no calibration; `mtu` is its largest payload in bytes, `version` the session's protocol, `capabilities` what
    the camera can do beyond streaming.
    """

    device_id: bytes
    boot_id: int
    calibration_hash: bytes
    mtu: int
    version: int
    capabilities: Capability = Capability.NONE


@dataclass(frozen=True, slots=True)
class Meeting:
    """A session that has begun: its nonce, who answered, and what already followed the answer.

    `framer` numbers the host's packets.
    """

    nonce: int
    identity: CameraIdentity
    framer: Framer
    early: tuple[Packet, ...]


def meet(link: Link, deframer: Deframer, timeout_s: float, stopping: threading.Event | None = None) -> Meeting:
    """Begin a new session on an open link, whose bytes go through `deframer`.

    Raises LinkLost when nothing answers in time or `stopping` is set, DeviceError when the device speaks no version of the
    protocol that this host speaks.
    """
    nonce = secrets.randbelow(0xFFFF_FFFF) + 1
    framer = Framer(nonce)
    deframer.adopt(nonce)
    heard_before = deframer.statistics.received_bytes
    deadline = time.monotonic() + timeout_s
    offer_at = 0.0
    while (now := time.monotonic()) < deadline and not (stopping and stopping.is_set()):
        if now >= offer_at:
            offer_at = now + _OFFER_EVERY_S
            link.write(offer(framer, nonce))
        packets = deframer.feed(link.read(_POLL_S))
        for position, packet in enumerate(packets):
            identity = answer_to(packet, nonce, link.name)
            if identity is not None:
                return Meeting(nonce, identity, framer, tuple(packets[position + 1 :]))
    heard = deframer.statistics.received_bytes - heard_before
    raise LinkLost(
        f"nothing on {link.name} answered a hello within {timeout_s:g} s ({heard} bytes heard): "
        "check that a sensor is there, that its service runs, and the baud rate"
    )


def offer(framer: Framer, nonce: int) -> bytes:
    """Make the bytes of an offer. The 0x00 ahead ends whatever was left half sent."""
    return b"\0" + framer.encode(Channel.HELLO, Hello(nonce, capabilities=Capability.COMPACT).pack())


def answer_to(packet: Packet, nonce: int, name: str) -> CameraIdentity | None:
    """Give the device that accepts this very offer, None for any other packet; raises DeviceError on a refusal."""
    if packet.channel != Channel.HELLO:
        return None
    try:
        said = read_hello(packet.payload)
    except WireError:
        return None
    if said.nonce != nonce:
        return None
    if isinstance(said, HelloReply):
        if VERSION_MIN <= said.version <= VERSION_MAX:
            able = Capability.known(said.capabilities)
            return CameraIdentity(said.device_id, said.boot_id, said.calibration_hash, said.mtu, said.version, able)
        raise _other_version(name, said.version, said.version)
    if said.kind is HelloKind.REFUSE:
        raise _other_version(name, said.version_min, said.version_max)
    return None  # our own offer, echoed


def _other_version(name: str, lowest: int, highest: int) -> DeviceError:
    return DeviceError(
        f"the sensor on {name} speaks protocol versions {lowest} to {highest}, "
        f"this program {VERSION_MIN} to {VERSION_MAX}: update the older of the two"
    )
