"""Meeting: the host draws a nonce and offers a range of versions, the device accepts or refuses.

The nonce becomes the session: it salts the check sum of every later packet, so what is left of an earlier session is
never mistaken for this one. Replug, reboot and host restart are all the same way: hello again.
"""

from __future__ import annotations

import hashlib
import struct
from dataclasses import dataclass
from enum import IntEnum, IntFlag
from typing import ClassVar, Self

from prismstereo_device.protocol.body import read_fields, read_grown
from prismstereo_device.wire import LIMITS, VERSION_MAX, VERSION_MIN, WireError

__all__ = ["Capability", "Hello", "HelloKind", "HelloReply", "calibration_hash", "read_hello"]

_NONE = bytes(8)


class HelloKind(IntEnum):
    """First byte of every body on the hello channel."""

    OFFER = 1  # host to device: a range of versions, a nonce, what the host reads
    ACCEPT = 2  # device to host: a HelloReply
    REFUSE = 3  # device to host: the device's own range, where the two do not overlap


class Capability(IntFlag):
    """What an end can do beyond codec 1 and reading objects; an end that says nothing can do nothing of it."""

    NONE = 0
    COMPACT = 1  # disparity in codec 2
    COMMANDS = 2  # the command channel
    WRITE = 4  # objects can be written
    STILL = 8
    RAW = 16  # the sensor's own frames
    PREVIEW = 32
    ZONES = 64
    PLANES = 128  # reasons and confidence

    @classmethod
    def known(cls, bits: int) -> Capability:
        """Take the bits of any version: those that this one does not know are left out."""
        return cls(bits & _KNOWN)


_KNOWN = int(~Capability.NONE)


def calibration_hash(calibration: bytes) -> bytes:
    """Name a calibration's flash bytes by 8 bytes; zeros where there is none."""
    return hashlib.sha256(calibration).digest()[:8] if calibration else _NONE


@dataclass(frozen=True, slots=True)
class Hello:
    """An offer, or its refusal: the sender's range of versions and the host's nonce (1 .. 2^32 - 1).

    `capabilities` is what the host reads: COMPACT, or nothing where it is older than that.
    """

    nonce: int
    version_min: int = VERSION_MIN
    version_max: int = VERSION_MAX
    kind: HelloKind = HelloKind.OFFER
    capabilities: Capability = Capability.NONE

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBBI")
    _CAPABILITIES: ClassVar[struct.Struct] = struct.Struct("<I")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        head = self._LAYOUT.pack(self.kind, self.version_min, self.version_max, self.nonce)
        return head + self._CAPABILITIES.pack(self.capabilities)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read an offer or a refusal; raises WireError."""
        kind, version_min, version_max, nonce = read_fields(cls._LAYOUT, body, "a hello")
        if kind not in (HelloKind.OFFER, HelloKind.REFUSE):
            raise WireError(f"a hello of kind {kind}: 1 offers, 3 refuses")
        if not nonce or version_min > version_max:
            raise WireError(f"a hello with nonce {nonce}, versions {version_min}..{version_max}: neither may be empty")
        (bits,) = read_grown(cls._CAPABILITIES, body, cls._LAYOUT.size) or (0,)
        return cls(nonce, version_min, version_max, HelloKind(kind), Capability.known(bits))

    def shared_version(self) -> int | None:
        """Give the newest version that the sender and this end both speak, None where there is no such."""
        version = min(self.version_max, VERSION_MAX)
        return version if version >= max(self.version_min, VERSION_MIN) else None


@dataclass(frozen=True, slots=True)
class HelloReply:
    """The device accepts: the version and largest payload of the session, and who it is (two names of 8 bytes).

    `capabilities` is what the device can do; nothing, where it is older than commands.
    """

    version: int
    nonce: int
    mtu: int
    device_id: bytes
    boot_id: int
    calibration_hash: bytes
    capabilities: Capability = Capability.NONE

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<BBIH8sI8sI")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        head = (HelloKind.ACCEPT, self.version, self.nonce, self.mtu)
        return self._LAYOUT.pack(*head, self.device_id, self.boot_id, self.calibration_hash, self.capabilities)

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read an acceptance; raises WireError."""
        kind, version, nonce, mtu, device_id, boot_id, name, bits = read_fields(cls._LAYOUT, body, "a hello reply")
        if kind != HelloKind.ACCEPT:
            raise WireError(f"a hello reply of kind {kind}: 2 accepts")
        if not nonce or not LIMITS.payload_min <= mtu <= LIMITS.payload:
            raise WireError(
                f"a hello reply with nonce {nonce} and MTU {mtu}: the nonce is not 0, "
                f"the MTU {LIMITS.payload_min} to {LIMITS.payload}"
            )
        return cls(version, nonce, mtu, device_id, boot_id, name, Capability.known(bits))


def read_hello(body: bytes) -> Hello | HelloReply:
    """Read whatever came on the hello channel; raises WireError."""
    if body[:1] == bytes([HelloKind.ACCEPT]):
        return HelloReply.unpack(body)
    return Hello.unpack(body)
