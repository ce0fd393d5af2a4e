"""What a host can change while the camera runs, by name; a frozen whole, and the rule that each value obeys.

A setting that was never given a value is `auto`: the camera's own automatic, the line's own choice, or all of the picture.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

import msgspec

from prismstereo_device.match import DEFAULT, MATCHERS
from prismstereo_device.protocol.command import Value
from prismstereo_device.sensors.base import Limit, SensorLimits
from prismstereo_hw.errors import UsageError

__all__ = ["AUTO", "BOUNDS", "SettingRule", "SettingRules", "Settings"]

AUTO: Literal["auto"] = "auto"
BOUNDS = (0, 1, 2, 4)  # largest errors of the disparity coder, in sixteenths of a pixel

Automatic = Literal["auto"]
Region = tuple[int, int, int, int]
_SWITCHES = {
    "stream": "disparity maps",
    "preview": "the rectified left picture as JPEG",
    "raw": "the sensor's own frames; without `stream` nothing is matched",
    "zones": "the nearest distance of each zone of the picture",
    "reasons": "why pixels are unmatched",
    "confidence": "how sure matches are",
}


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All settings. `region` is x, y, width, height of the left rectified picture, in pixels."""

    exposure_us: float | Automatic = AUTO
    gain: float | Automatic = AUTO  # a factor, 1 = none
    rate_hz: float | Automatic = AUTO  # auto: as the sensor was opened
    lens_position: int | Automatic = AUTO  # auto: where the calibration was made, or as it stands
    region: Region | Automatic = AUTO  # auto: all of the picture
    matcher: str = DEFAULT
    bound: int | Automatic = AUTO  # sixteenths of a pixel; auto: what the line can carry
    stream: bool = True
    preview: bool = False
    raw: bool = False
    zones: bool = False
    reasons: bool = False
    confidence: bool = False

    @property
    def matches(self) -> bool:
        """Whether frames have to be matched at all."""
        return self.stream or self.zones

    def value(self, name: str) -> Value:
        """Give a setting in the form it has on the wire."""
        found = getattr(self, name)
        return list(found) if isinstance(found, tuple) else found

    def with_value(self, name: str, value: Value, rules: SettingRules) -> Settings:
        """Change one setting; `UsageError` where its rule, or another setting, forbids the value."""
        changed = msgspec.structs.replace(self, **{name: rules[name].checked(value)})
        rules.require_together(changed)
        return changed

    def checked(self, rules: SettingRules) -> Settings:
        """Give the same settings, each of them held to its rule; `UsageError` for the first that breaks its own."""
        untouched = Settings()
        found = msgspec.structs.replace(untouched, matcher=rules["matcher"].choices[0])
        for name in rules:
            if self.value(name) != untouched.value(name):
                found = msgspec.structs.replace(found, **{name: rules[name].checked(self.value(name))})
        rules.require_together(found)
        return found


@dataclass(frozen=True, slots=True)
class SettingRule:
    """What one setting can be: its kind, its unit, its range or choices, and whether `auto` can be set.

    `unavailable` says why it cannot be set at all; empty where it can. `least` and `most` are the borders of a number, and
    the size (width, height) that a region has to lie in.
    """

    name: str
    kind: Literal["number", "whole", "switch", "choice", "region"]
    unit: str = ""
    least: float = 0.0
    most: float = 0.0
    size: tuple[int, int] = (0, 0)
    choices: tuple[str | int, ...] = ()
    automatic: bool = False
    unavailable: str = ""
    about: str = ""

    def checked(self, value: Value) -> bool | int | float | str | Region:
        """Give the value in the form that `Settings` keeps; `UsageError` says what it may be."""
        if self.unavailable and value is not False:
            raise UsageError(f"{self.name}: {self.unavailable}")
        if value == AUTO and self.automatic:
            return AUTO
        match self.kind:
            case "switch":
                return self._switched(value)
            case "choice":
                return self._chosen(value)
            case "region":
                return self._inside(value)
        return self._number(value)

    def described(self) -> dict[str, object]:
        """Say it in JSON's words, so that a host can build its page from it."""
        told: dict[str, object] = {"name": self.name, "kind": self.kind, "automatic": self.automatic}
        if self.unit:
            told["unit"] = self.unit
        if self.kind in ("number", "whole"):
            told |= {"least": self.least, "most": self.most}
        if self.kind == "region":
            told |= {"width": self.size[0], "height": self.size[1]}
        for key, said in (("choices", self.choices), ("unavailable", self.unavailable), ("about", self.about)):
            if said:
                told[key] = said
        return told

    def _refusal(self, value: Value, rule: str) -> UsageError:
        also = " or auto" if self.automatic else ""
        return UsageError(f"{self.name} {str(value)[:40]}: give {rule}{also}")

    def _switched(self, value: Value) -> bool:
        if not isinstance(value, bool):
            raise self._refusal(value, "true or false")
        return value

    def _chosen(self, value: Value) -> str | int:
        for choice in self.choices:
            if type(choice) is type(value) and choice == value:
                return choice
        raise self._refusal(value, f"one of {', '.join(map(str, self.choices))}")

    def _number(self, value: Value) -> float | int:
        whole = self.kind == "whole"
        fits = isinstance(value, int if whole else int | float) and not isinstance(value, bool)
        if fits and isinstance(value, int | float) and self.least <= value <= self.most and math.isfinite(value):
            return int(value) if whole else float(value)
        unit = f" {self.unit}" if self.unit else ""
        raise self._refusal(
            value, f"{'a whole number' if whole else 'a number'} from {self.least:g} to {self.most:g}{unit}"
        )

    def _inside(self, value: Value) -> Region:
        width, height = self.size
        if isinstance(value, list) and len(value) == 4 and all(type(part) is int for part in value):
            x, y, w, h = value
            if x >= 0 and y >= 0 and w > 0 and h > 0 and x + w <= width and y + h <= height:
                return x, y, w, h
        raise self._refusal(value, f"[x, y, width, height] inside {width}x{height} pixels")


@dataclass(frozen=True, slots=True)
class SettingRules(Mapping[str, SettingRule]):
    """The rules of all settings by name, and what they have to agree about."""

    rules: Mapping[str, SettingRule]
    calibrated_lens: int | None = None

    @classmethod
    def of(
        cls,
        limits: SensorLimits,
        picture: tuple[int, int],
        *,
        matcher: str = DEFAULT,
        calibrated_lens: int | None = None,
    ) -> SettingRules:
        """Make the rules of a sensor with these limits and rectified pictures of this size (width, height).

        `matcher` is the one of the start: it may always be gone back to.
        """
        names = (matcher, *(name for name in MATCHERS if name != matcher))
        made = [
            _limited("exposure_us", "number", limits.exposure_us, "us", automatic=True),
            _limited("gain", "number", limits.gain, "", automatic=True),
            _limited("rate_hz", "number", limits.rate_hz, "Hz", automatic=False),
            _limited("lens_position", "whole", limits.lens_position, "", automatic=False),
            SettingRule("region", "region", "px", size=picture, automatic=True),
            SettingRule("matcher", "choice", choices=names),
            SettingRule("bound", "choice", "1/16 px", choices=BOUNDS, automatic=True),
            *(SettingRule(name, "switch", about=about) for name, about in _SWITCHES.items()),
        ]
        return cls(MappingProxyType({rule.name: rule for rule in made}), calibrated_lens)

    def __getitem__(self, name: str) -> SettingRule:
        return self.rules[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.rules)

    def __len__(self) -> int:
        return len(self.rules)

    def require_together(self, settings: Settings) -> None:
        """Refuse to match pictures of another focus than the calibration's; `UsageError`."""
        position, calibrated = settings.lens_position, self.calibrated_lens
        if settings.matches and position != AUTO and calibrated is not None and position != calibrated:
            raise UsageError(
                f"lens_position {position}: the calibration is for {calibrated}; set stream and zones to false first"
            )


def _limited(
    name: str, kind: Literal["number", "whole"], limit: Limit | None, unit: str, *, automatic: bool
) -> SettingRule:
    if limit is None:
        return SettingRule(name, kind, unit, unavailable="this sensor cannot set it; leave it as it is")
    return SettingRule(name, kind, unit, limit.least, limit.most, automatic=automatic)
