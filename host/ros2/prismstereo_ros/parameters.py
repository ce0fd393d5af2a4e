"""The camera's settings as ROS parameters: names, ranges and units as the camera itself tells them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

__all__ = ["AUTO", "Rule", "rules_of", "setting_of"]

AUTO = "auto"
Kind = Literal["double", "integer", "any"]
_RANGED: dict[str, Kind] = {"number": "double", "whole": "integer"}


@dataclass(frozen=True, slots=True)
class Rule:
    """How one setting is declared: its limits (of numbers), and whether its type may change, as between 8000.0 and "auto"."""

    name: str
    kind: Kind
    dynamic: bool
    description: str
    constraints: str = ""
    least: float = 0.0
    most: float = 0.0


def rules_of(identity: Mapping[str, object]) -> tuple[Rule, ...]:
    """Read the settings that this camera has from its identity; those that it cannot set are left out."""
    told = identity.get("settings")
    if not isinstance(told, list):
        return ()
    return tuple(_rule(one) for one in told if isinstance(one, dict) and "name" in one and not one.get("unavailable"))


def _rule(told: Mapping[str, object]) -> Rule:
    kind = _RANGED.get(str(told.get("kind")), "any")
    automatic, choices = bool(told.get("automatic")), told.get("choices")
    unit, about = str(told.get("unit") or ""), str(told.get("about") or "")
    described = " ".join(part for part in (about, f"[{unit}]" if unit else "") if part)
    words = [f"one of {', '.join(map(str, choices))}"] if isinstance(choices, list) else []
    if told.get("kind") == "region":
        words.append(f"[x, y, width, height] inside {told.get('width')}x{told.get('height')}")
    words += [AUTO] if automatic else []
    least, most = (float(str(told.get(key) or 0.0)) for key in ("least", "most"))
    mixed = automatic or (isinstance(choices, list) and len({type(choice) for choice in choices}) > 1)
    return Rule(str(told["name"]), kind, mixed, described, " or ".join(words), least, most)


def setting_of(rule: Rule, value: object) -> bool | int | float | str | list[int]:
    """Turn a parameter's value into the setting's; a number where ROS was given a whole one is fine."""
    if isinstance(value, bool | str):
        return value
    if isinstance(value, int):
        return float(value) if rule.kind == "double" else value
    if isinstance(value, float):
        return int(value) if rule.kind == "integer" and value.is_integer() else value
    return [int(part) for part in value] if isinstance(value, Iterable) else str(value)
