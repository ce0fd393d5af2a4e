"""The program's configuration, a TOML file; every field may be left out, and options of the command line go before it.

sensor = "v4l2:/dev/video0?rig=oak-1"
link = "/dev/ttyGS0"
filters = "robot"

[settings]
matcher = "tiles"
rate_hz = 15.0
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from prismstereo_device.control.identity import without_password
from prismstereo_device.control.settings import Settings
from prismstereo_device.control.stills import Encoding
from prismstereo_hw.errors import UsageError

__all__ = ["Configuration", "LogLevel"]

_MOST_BYTES = 64 * 1024

LogLevel = Literal["debug", "info", "warning", "error"]
_Rate = Annotated[float, Meta(gt=0, le=1000)]
_Name = Annotated[str, Meta(max_length=64, pattern=r"^[^\x00-\x1f]*$")]


class Configuration(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that the program can be told before it starts. Paths are relative to the folder that it is started in."""

    sensor: str = ""
    """Where frames come from, as `--sensor` takes it; nothing starts without one."""
    link: str = "pty"
    """Where hosts are: `pty`, `tcp:HOST:PORT`, or a serial port."""
    symlink: str = ""
    """A stable name for the pseudo-terminal."""
    baud: Annotated[int, Meta(ge=1200, le=50_000_000)] | None = None
    """Speed of a serial port, or of a pseudo-terminal that is to be as slow as one; none: the port's usual speed."""
    rtscts: bool | None = None
    """RTS/CTS handshake of a serial port; none: on above 1 Mbaud."""
    calibration: str = ""
    """JSON or flash bytes that hold until a host writes a calibration; empty: what the sensor's rig promises."""
    filters: str = ""
    """Filters behind the matcher: a preset's name or a TOML file; empty: none."""
    state: str = ""
    """Folder for what outlives a restart; empty: $STATE_DIRECTORY, and without that nothing is kept."""
    led: str = ""
    """A lamp's folder below /sys/class/leds; empty: none."""
    product: _Name = "prismstereo"
    """What the maker calls this kind of camera; updates are for one product."""
    serial: _Name = ""
    """The unit's serial number; empty: the number that it made for itself."""
    name: _Name = ""
    """What its owner calls it."""
    update_key: str = ""
    """File with the Ed25519 public key that updates are signed for; empty: none is taken."""
    still_encoding: Encoding = "png"
    """How stills are compressed."""
    preview_hz: _Rate = 5.0
    """Most preview pictures a second."""
    target_hz: _Rate | None = None
    """Disparity frames a second that the line should carry, at coarser steps where it must; none: as many as there are."""
    give_up_s: Annotated[float, Meta(gt=0)] | None = None
    """How long to wait for a camera that went away; none: for ever."""
    frames: Annotated[int, Meta(ge=1)] | None = None
    """Stop after so many frames; none: never."""
    lossless: bool = False
    """Wait for the host instead of dropping frames."""
    log_level: LogLevel = "warning"
    """Which lines go to standard error."""
    settings: Settings = Settings()
    """What a host may change later, as it is at the start."""

    @classmethod
    def read(cls, path: Path) -> Configuration:
        """Read a file; `UsageError` names the file and the field that is wrong."""
        if not os.path.isfile(path):  # unlike Path.is_file, says no to a name that no file can have
            raise UsageError(f"there is no configuration {str(path)!r}: give a TOML file")
        try:
            if path.stat().st_size > _MOST_BYTES:
                raise UsageError(f"{path} has {path.stat().st_size} bytes: a configuration has at most {_MOST_BYTES}")
            return cls.parse(path.read_text("utf-8-sig"), str(path))  # editors put a byte order mark there
        except (OSError, UnicodeDecodeError) as error:
            raise UsageError(f"{path} cannot be read as UTF-8 text: {error}") from error

    @classmethod
    def parse(cls, text: str, origin: str) -> Configuration:
        """Make a configuration of TOML text; `origin` is named in every complaint (`UsageError`)."""
        try:
            return msgspec.toml.decode(text, type=cls)
        except msgspec.ValidationError as error:
            raise UsageError(f"{origin}: {error}: compare with `prismstereo-device --check`") from error
        except (msgspec.DecodeError, RecursionError) as error:
            raise UsageError(f"{origin} is not TOML: {error}") from error

    def with_options(self, **given: object) -> Configuration:
        """Put options before the file's fields; those that are None were not given. `UsageError` as for a file."""
        fields = {name: value for name, value in given.items() if value is not None}
        settings = {name: fields.pop(name) for name in ("matcher", "rate_hz") if name in fields}
        plain = msgspec.to_builtins(self) | fields
        plain["settings"] |= settings
        try:
            return msgspec.convert(plain, type(self))
        except msgspec.ValidationError as error:
            raise UsageError(f"the command line: {error}: see `prismstereo-device --help`") from error

    @property
    def state_folder(self) -> Path | None:
        """The folder for what outlives a restart; None where nothing does."""
        found = self.state or os.environ.get("STATE_DIRECTORY", "").partition(":")[0]
        return Path(found) if found else None

    def shown(self) -> dict[str, object]:
        """Give all fields as plain values, with no password in them."""
        plain: dict[str, object] = msgspec.to_builtins(self)
        return plain | {"sensor": without_password(self.sensor)}
