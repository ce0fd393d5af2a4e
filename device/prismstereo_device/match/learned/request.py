"""What was asked for: `onnx:MODEL.onnx[,preset=NAME][,provider=NAME]...[,check=yes][,scale=...]`."""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import msgspec

from prismstereo_device.match.learned.convention import Convention
from prismstereo_device.match.learned.presets import presets, recognised
from prismstereo_hw.errors import UsageError

__all__ = ["PREFIX", "Request"]

PREFIX = "onnx:"
_FORM = f"{PREFIX}MODEL.onnx[,preset=NAME][,provider=NAME][,check=yes]"
_NEXT_OPTION = re.compile(r",(?=[a-z_]+=)")
_ANSWERS = {"yes": True, "no": False}


@dataclass(frozen=True, slots=True)
class Request:
    """A model file, which preset it goes by (None: recognise it), what differs from the preset, and how to run it.

    `providers` are onnxruntime's, first choice first, none for its processor one. `check`: run the mirrored pair as well, and
    match only where both views agree.
    """

    path: Path
    preset: str | None = None
    providers: tuple[str, ...] = ()
    check: bool = False
    changes: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def parse(cls, name: str) -> Request:
        """Read a matcher name; `UsageError` shows the form, or the presets and options there are."""
        path, *options = _NEXT_OPTION.split(name.removeprefix(PREFIX))
        if not path or not name.startswith(PREFIX):
            raise UsageError(f"matcher {name!r} names no model: give {_FORM}")
        preset: str | None = None
        providers: list[str] = []
        check = False
        changes: dict[str, str] = {}
        for option in options:
            key, _, value = option.partition("=")
            if key == "preset":
                preset = _known_preset(value)
            elif key == "provider":
                providers.append(value)
            elif key == "check":
                check = _answer(value)
            elif key in Convention.__struct_fields__:
                changes[key] = value
            else:
                known = ", ".join(("preset", "provider", "check", *Convention.__struct_fields__))
                raise UsageError(f"a learned matcher has no option {key!r}: the options are {known}")
        return cls(Path(path), preset, tuple(providers), check, changes)

    def convention(self, nodes: Iterable[str]) -> Convention:
        """Return how the model wants its pictures, by preset and changes; `nodes` are names of its inputs and outputs.

        `UsageError` where nothing tells, or a change is none.
        """
        preset = self.preset or recognised(self.path, nodes)
        fields: dict[str, object] = {}
        if preset is not None:
            known = presets()[preset]
            fields = {key: getattr(known, key) for key in Convention.__struct_fields__}
        fields.update(self.changes)
        if "scale" not in fields:
            raise UsageError(
                f"nothing tells how {self.path} wants its pictures: add preset=NAME ({', '.join(presets())}), or "
                "scale=none, unit, symmetric or imagenet"
            )
        try:
            return msgspec.convert(fields, Convention, strict=False)
        except msgspec.ValidationError as error:
            given = ",".join(f"{key}={value}" for key, value in self.changes.items())
            raise UsageError(f"option {given!r} of {self.path}: {error}") from error


def _known_preset(name: str) -> str:
    if name not in presets():
        raise UsageError(f"there is no preset {name!r}: choose one of {', '.join(presets())}")
    return name


def _answer(value: str) -> bool:
    if value not in _ANSWERS:
        raise UsageError(f"check={value}: give check=yes or check=no")
    return _ANSWERS[value]
