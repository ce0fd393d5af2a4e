"""What a camera can be told and asked: settings by name, actions, stills, findings, calibrations and updates."""

from __future__ import annotations

import secrets
import time
from collections.abc import Callable

import msgspec

from prismstereo.camera_settings import CameraSettings
from prismstereo.meeting import CameraIdentity
from prismstereo.requests import OutcomeUnknown, Requests
from prismstereo.still import StillPicture, StillState
from prismstereo.transfer import ObjectTransfer
from prismstereo_device.objects import ObjectNumber
from prismstereo_device.protocol import Capability
from prismstereo_device.protocol.command import Command, CommandReply, CommandStatus, Value, Verb
from prismstereo_device.sensors.base import StampQuality
from prismstereo_device.wire import LIMITS, WireError
from prismstereo_hw.errors import DataError, DeviceError, UsageError

__all__ = ["CameraControls"]

_ASK_EVERY_S = 0.05
_JSON_BYTES = 256 << 10
_LOG_BYTES = 4 << 20


class CameraControls:
    """Commands and objects of one camera, whose sessions `identity` follows; `name` is its port, for errors.

    Every call waits for the camera's word and may be made from any thread but the one that reads the line (an event's
    callback). All of them raise OutcomeUnknown where a session ended between question and answer, LinkLost where the camera
    is not there, UsageError where it cannot do or will not have it, DeviceError where it tried and failed.
    """

    def __init__(
        self, commands: Requests, transfer: ObjectTransfer, identity: Callable[[], CameraIdentity], name: str
    ) -> None:
        self._commands = commands
        self._transfer = transfer
        self._identity = identity
        self._name = name
        self._details: tuple[CameraIdentity, dict[str, object]] | None = None
        self._stamps: tuple[CameraIdentity, StampQuality | None] | None = None

    def get(self, name: str) -> Value:
        """Ask for a setting, or for something that can only be asked for (`uptime_s`, `temperature_c`)."""
        return self._command("get", name, None)

    def set(self, name: str, value: Value) -> Value:
        """Set a setting and return what is in force now.

        >>> camera.set("exposure_us", 8000.0)  # doctest: +SKIP
        8000.0
        """
        self._details = None  # one setting may change what others can be
        return self._command("set", name, value)

    @property
    def settings(self) -> CameraSettings:
        """All settings by name, each with its value, unit, range and help; assigning one sets it, checked beforehand."""
        return CameraSettings(self._known_details, self.get, self.set)

    def do(self, name: str, value: Value = None) -> Value:
        """Let the camera do something; a reboot is answered before it begins."""
        return self._command("do", name, value)

    def still(self, crop: tuple[int, int, int, int] | None = None, *, timeout_s: float = 30.0) -> StillPicture:
        """Take a full-sensor picture between two frames and fetch it; `crop` (x, y, width, height) of the sensor's pixels.

        `timeout_s` is for the taking; the fetching takes what the line needs (a minute for 5 MB at 921600 baud).
        """
        number = secrets.randbelow(0xFFFF_FFFF) + 1
        self.do("still", [number, *(crop or ())])
        state = self._still_state(number, timeout_s)
        data = self._transfer.read(ObjectNumber.STILL, LIMITS.object, version=number)
        return StillPicture.of(state, data)

    def _still_state(self, number: int, timeout_s: float) -> StillState:
        deadline_s = time.monotonic() + timeout_s
        while time.monotonic() < deadline_s:
            state = StillState.read(self.get("still"))
            if state.id != number:
                raise DeviceError(f"still {number} of {self._name} was replaced by still {state.id}: ask again")
            if state.state == "failed":
                raise DeviceError(f"{self._name} took no still: {state.why or 'it does not say why'}")
            if state.state == "ready":
                return state
            time.sleep(_ASK_EVERY_S)
        raise DeviceError(f"still {number} of {self._name} was not ready within {timeout_s:g} s: do frames arrive?")

    @property
    def identity_details(self) -> dict[str, object]:
        """Who the camera is, what it can do, and its modes, in its own words."""
        identity = self._identity()
        details = self._json(ObjectNumber.IDENTITY)
        self._details = identity, details
        return details

    @property
    def stamp_quality(self) -> StampQuality | None:
        """What the frames' stamps mean, asked once in a session; None where the camera does not tell, or is not there."""
        identity = self._identity()
        if self._stamps is None or self._stamps[0] is not identity:
            try:
                self._stamps = identity, StampQuality(self._known_details().get("stamp_quality"))
            except (DataError, ValueError):
                self._stamps = identity, None
            except DeviceError:  # asked again next time
                return None
        return self._stamps[1]

    def _known_details(self) -> dict[str, object]:
        """Give the identity object as it was told last in this session."""
        details = self._details
        return details[1] if details is not None and details[0] is self._identity() else self.identity_details

    def self_test(self, *, timeout_s: float = 3.0) -> dict[str, object]:
        """Let the camera test itself and return its findings."""
        return self._findings("self_test", ObjectNumber.SELF_TEST, timeout_s)

    def optics(self, *, timeout_s: float = 3.0) -> dict[str, object]:
        """Let the camera look at its lens, mirrors and prism (dust, a blocked half, a moved seam) and return its findings."""
        return self._findings("optics", ObjectNumber.OPTICS, timeout_s)

    def log(self) -> str:
        """Give the last lines of the camera's log."""
        return self._transfer.read(ObjectNumber.LOG, _LOG_BYTES).decode(errors="replace")

    def read_calibration(self) -> bytes:
        """Read the flash bytes of the camera's calibration as it holds them now; DataError where it has none."""
        return self._transfer.read(ObjectNumber.CALIBRATION, LIMITS.calibration)

    def write_calibration(self, content: bytes) -> None:
        """Make these flash bytes the camera's calibration; it verifies them, and keeps the old one where it refuses them."""
        self._require(Capability.WRITE, "takes no calibration")
        self._transfer.write(ObjectNumber.CALIBRATION, content)

    def restore_calibration(self, *, timeout_s: float = 5.0) -> bytes:
        """Go back to the first calibration that the camera ever had, wait until it is in use, and return its flash bytes.

        DataError where none was ever written to it.
        """
        first = self._held(ObjectNumber.FACTORY_CALIBRATION)
        if first is None:
            raise DataError(f"no calibration was ever written to {self._name}, so there is no first one: write one")
        self.do("restore_calibration")
        deadline_s = time.monotonic() + timeout_s
        while self.read_calibration() != first:
            if time.monotonic() > deadline_s:
                raise DeviceError(f"{self._name} has not gone back to its first calibration within {timeout_s:g} s")
            time.sleep(_ASK_EVERY_S)
        return first

    def send_update(self, bundle: bytes) -> None:
        """Send a signed update; the camera checks signature, product and version before it takes it."""
        self._require(Capability.WRITE, "takes no updates")
        self._transfer.write(ObjectNumber.UPDATE, bundle)

    def _command(self, verb: Verb, name: str, value: Value) -> Value:
        return self._judged(self._ask(verb, name, value), verb, name)

    def _ask(self, verb: Verb, name: str, value: Value) -> CommandReply:
        self._require(Capability.COMMANDS, "takes no commands")
        body = Command(verb, name, value).pack()
        try:
            Command.unpack(body)
        except WireError as error:
            raise UsageError(f"{verb} {name!r}: {error}") from error
        if len(body) > self._identity().mtu:
            raise UsageError(f"{verb} {name}: {len(body)} bytes, the line carries {self._identity().mtu} at once")
        return CommandReply.unpack(self._commands.ask(body).result())

    def _judged(self, reply: CommandReply, verb: Verb, name: str) -> Value:
        said = f"{verb} {name} on {self._name}: {reply.why or reply.status.name.lower()}"
        match reply.status:
            case CommandStatus.OK:
                return reply.value
            case CommandStatus.UNKNOWN | CommandStatus.REFUSED:
                raise UsageError(said)
            case CommandStatus.STALE:
                raise OutcomeUnknown(said)
        raise DeviceError(said)

    def _require(self, capability: Capability, lack: str) -> None:
        if not self._identity().capabilities & capability:
            raise UsageError(f"the sensor on {self._name} {lack}: its firmware is older than that, update it")

    def _findings(self, action: str, obj: ObjectNumber, timeout_s: float) -> dict[str, object]:
        """Order findings and wait for them; where they do not change within the time, they are what they were."""
        before = self._held(obj)
        reply = self._ask("do", action, None)
        if reply.status is not CommandStatus.BUSY:  # else they are under way already
            self._judged(reply, "do", action)
        deadline_s = time.monotonic() + timeout_s
        while (found := self._held(obj)) == before and time.monotonic() < deadline_s:
            time.sleep(_ASK_EVERY_S)
        if found is None:
            raise DeviceError(f"{action} on {self._name} gave no findings within {timeout_s:g} s: do frames arrive?")
        return _read_json(found, obj, self._name)

    def _held(self, obj: ObjectNumber) -> bytes | None:
        try:
            return self._transfer.read(obj, _JSON_BYTES)
        except WireError:
            raise
        except DataError:
            return None

    def _json(self, obj: ObjectNumber) -> dict[str, object]:
        return _read_json(self._transfer.read(obj, _JSON_BYTES), obj, self._name)


def _read_json(content: bytes, obj: ObjectNumber, name: str) -> dict[str, object]:
    try:
        return msgspec.json.decode(content, type=dict[str, object])
    except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError) as error:
        raise WireError(
            f"{obj.name.lower()} of {name} cannot be read ({error}): update the sensor, or this program"
        ) from error
