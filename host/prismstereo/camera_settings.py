"""A camera's settings as a mapping: each with its value, unit, range and help; what is set is checked before it is sent."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from typing import Literal, cast, get_args

import msgspec

from prismstereo_device.control.settings import SettingRule
from prismstereo_device.protocol.command import Value
from prismstereo_device.wire import WireError
from prismstereo_hw.errors import UsageError

__all__ = ["CameraSettings", "Setting"]

Kind = Literal["number", "whole", "switch", "choice", "region"]
_HELP = {
    "exposure_us": "time of exposure; both views share it",
    "gain": "factor after the exposure, 1 is none; both views share it",
    "rate_hz": "frames a second",
    "lens_position": "focus; depth is right only where the calibration was made",
    "region": "rectangle of the rectified picture that is matched: x, y, width, height",
    "matcher": "what finds the disparities",
    "bound": "how far a disparity on the line may be off, so that it takes fewer bytes",
}


@dataclass(frozen=True, slots=True)
class Setting:
    """One setting as it stands: `value`, and what it may be.

    `kind` is number, whole, switch, choice or region; `least` and `most` are the borders of a number, `size` those of a
    region (width, height in px), `choices` those of a choice; None and empty where they do not apply. `automatic`: "auto" may
    be set, too. `unavailable` says why it cannot be set, and is empty where it can.
    """

    name: str
    value: Value
    kind: str
    unit: str = ""
    least: float | None = None
    most: float | None = None
    size: tuple[int, int] | None = None
    choices: tuple[str | int, ...] = ()
    automatic: bool = False
    unavailable: str = ""
    help: str = ""


class _Described(msgspec.Struct, frozen=True):
    """A setting in the words of the camera's identity object; fields that a later version adds are not looked at."""

    name: str
    kind: str
    automatic: bool = False
    unit: str = ""
    least: float = 0.0
    most: float = 0.0
    width: int = 0
    height: int = 0
    choices: tuple[str | int, ...] = ()
    unavailable: str = ""
    about: str = ""

    def checked(self, value: Value) -> Value:
        """Give the value as the camera keeps it; `UsageError` says what it may be. A kind unknown here is for the camera."""
        if self.kind not in get_args(Kind):
            return value
        rule = SettingRule(
            self.name,
            cast("Kind", self.kind),
            self.unit,
            self.least,
            self.most,
            (self.width, self.height),
            self.choices,
            self.automatic,
            self.unavailable,
        )
        found = rule.checked(list(value) if isinstance(value, tuple) else value)
        return list(found) if isinstance(found, tuple) else found

    def setting(self, value: Value) -> Setting:
        """Put it beside its value."""
        number = self.kind in ("number", "whole") and not self.unavailable
        return Setting(
            self.name,
            value,
            self.kind,
            self.unit,
            self.least if number else None,
            self.most if number else None,
            (self.width, self.height) if self.kind == "region" else None,
            self.choices,
            self.automatic,
            self.unavailable,
            self.about or _HELP.get(self.name, ""),
        )


class CameraSettings(Mapping[str, Setting]):
    """Settings by name. Looking one up asks the camera for its value; assigning one sets it.

    >>> camera.settings["exposure_us"] = 8000.0  # doctest: +SKIP
    >>> camera.settings["exposure_us"].most  # doctest: +SKIP
    30000.0

    A value that a setting cannot have is a UsageError before anything is sent, as is assigning to a name that there is not;
    looking that up is a KeyError. Otherwise it raises as `get` and `set` of the camera do. `described` gives the identity
    object.
    """

    def __init__(
        self,
        described: Callable[[], dict[str, object]],
        get: Callable[[str], Value],
        put: Callable[[str, Value], Value],
    ) -> None:
        self._described = described
        self._get = get
        self._put = put

    def __getitem__(self, name: str) -> Setting:
        known = self._table().get(name)
        if known is None:
            raise KeyError(name)
        return known.setting(self._get(name))

    def __setitem__(self, name: str, value: Value) -> None:
        self.change(name, value)

    def change(self, name: str, value: Value) -> Value:
        """Set a setting and return what is in force now."""
        table = self._table()
        if name not in table:
            raise UsageError(f"there is no setting {name[:40]!r}: there are {', '.join(table)}")
        return self._put(name, table[name].checked(value))

    def __contains__(self, name: object) -> bool:
        return name in self._table()

    def __iter__(self) -> Iterator[str]:
        return iter(self._table())

    def __len__(self) -> int:
        return len(self._table())

    def _table(self) -> dict[str, _Described]:
        try:
            rows = msgspec.convert(self._described().get("settings", []), type=list[_Described])
        except msgspec.ValidationError as error:
            raise WireError(
                f"the camera's settings cannot be read ({error}): update the camera, or this program"
            ) from error
        return {row.name: row for row in rows}
