"""Files of others, read with care: a value is asked for by name, and what is wrong is refused by that name.

YAML is taken as plain lists, mappings, texts and numbers; tags, aliases, a key twice and deep nesting are refused, so
nothing in a file can run, or grow when it is read. JSON likewise.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml
from numpy.typing import NDArray

from prismstereo_calibration.errors import CalibrationError
from prismstereo_hw.errors import UsageError

__all__ = ["MAX_BYTES", "Field", "read_json", "read_table", "read_text", "read_yaml", "resolve"]

Array = NDArray[np.float64]
MAX_BYTES = 256 * 1024
_MOST_LEVELS = 20
_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")
_PLAIN = {
    f"tag:yaml.org,2002:{name}" for name in ("map", "seq", "str", "int", "float", "bool", "null", "value", "timestamp")
}
_MATRIX = "tag:yaml.org,2002:opencv-matrix"  # a mapping with a name of its own
_LARGEST = 1e12
_MOST_PIXELS = 16384


@dataclass(frozen=True, slots=True)
class Field:
    """A value, and where it stands: the file and the keys that lead there."""

    value: object
    place: str

    def refuse(self, why: str) -> CalibrationError:
        """Return the complaint about this field."""
        return CalibrationError(f"{self.place} {why}")

    def __contains__(self, key: str) -> bool:
        """Tell whether this is a mapping with that key."""
        return isinstance(self.value, dict) and key in self.value

    def __getitem__(self, key: str | int) -> Field:
        """Return what stands under a key of a mapping, or an index of a list."""
        if isinstance(key, int):
            if not isinstance(self.value, list) or key >= len(self.value):
                raise self.refuse(f"is no list of more than {key} entries: the file was cut or is of another kind")
            return Field(self.value[key], f"{self.place}[{key}]")
        if not isinstance(self.value, dict):
            raise self.refuse(f"has no fields, but {key!r} is wanted there: the file is of another kind")
        if key not in self.value:
            raise self.refuse(f"has no field {key!r}: the file was cut or is of another kind")
        joint = ": " if ": " not in self.place else "."
        return Field(self.value[key], f"{self.place}{joint}{key}")

    def __len__(self) -> int:
        """Count the entries of a list; what is no list is refused."""
        if not isinstance(self.value, list):
            raise self.refuse(f"is {self.shown}, not a list")
        return len(self.value)

    @property
    def shown(self) -> str:
        """The value as a few characters."""
        text = repr(self.value)
        return text if len(text) <= 40 else f"{text[:40]}..."

    def number(self) -> float:
        """Return a finite number."""
        if isinstance(self.value, bool) or not isinstance(self.value, int | float):
            raise self.refuse(f"is {self.shown}, not a finite number: calibrate again or mend the file")
        if not math.isfinite(self.value) or abs(self.value) > _LARGEST:
            raise self.refuse(f"is {self.shown}: give a finite number of sane size")
        return float(self.value)

    def whole(self) -> int:
        """Return a whole number."""
        value = self.number()
        if not value.is_integer():
            raise self.refuse(f"is {value:g}, not a whole number")
        return int(value)

    def pixels(self) -> int:
        """Return the side of a picture."""
        value = self.whole()
        if not 1 <= value <= _MOST_PIXELS:
            raise self.refuse(f"is {value}: a picture has 1 to {_MOST_PIXELS} pixels a side")
        return value

    def text(self) -> str:
        """Return a text."""
        if not isinstance(self.value, str):
            raise self.refuse(f"is {self.shown}, not a text")
        return self.value

    def numbers(self, *shape: int) -> Array:
        """Return lists within lists as an array of that shape."""
        if len(self) != shape[0]:
            raise self.refuse(f"has {len(self)} entries, not {shape[0]}")
        entries = [self[index] for index in range(shape[0])]
        return np.array([entry.numbers(*shape[1:]) if shape[1:] else entry.number() for entry in entries])

    def row(self) -> Array:
        """Return a list of numbers (N,) of any length."""
        return self.numbers(len(self)) if len(self) else np.zeros(0)


def resolve(paths: Sequence[Path], names: tuple[str, ...], form: str) -> list[Path]:
    """Return the files that a format consists of, given as such, or as the folder that holds them; `UsageError` else."""
    if len(paths) == 1 and paths[0].is_dir():
        return [paths[0] / name for name in names]
    if len(paths) != len(names):
        raise UsageError(f"{len(paths)} files given, but {form} is {' and '.join(names)}: give these, in that order")
    return list(paths)


def read_text(path: Path) -> str:
    """Read a small text file; `CalibrationError` for what is missing, far too large or no text."""
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise CalibrationError(f"{path} cannot be read: {error.strerror}: give the files to convert") from error
    if len(content) > MAX_BYTES:
        raise CalibrationError(f"{path} has more than {MAX_BYTES} bytes: a calibration is far smaller")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise CalibrationError(f"{path} is not a text in UTF-8: save it as such") from error


def read_table(path: Path) -> list[Field]:
    """Read the lines of a text file as lists of words and numbers, empty lines and comments left out."""
    lines = enumerate(read_text(path).splitlines(), start=1)
    rows = [(count, line.split()) for count, line in lines if line.strip() and not line.lstrip().startswith("#")]
    return [Field([_word(word) for word in words], f"{path} line {count}") for count, words in rows]


def _word(text: str) -> float | str:
    return float(text) if _NUMBER.fullmatch(text) else text


def read_json(path: Path) -> Field:
    """Read a JSON file; `CalibrationError` names file and place of what is wrong."""
    text = read_text(path)
    try:
        value = json.loads(
            text, object_pairs_hook=lambda pairs: _mapping(pairs, path), parse_int=float, parse_constant=str
        )
    except (ValueError, RecursionError) as error:
        raise CalibrationError(f"{path} is not JSON that can be read: {error}") from error
    return Field(value, str(path))


def read_yaml(path: Path) -> Field:
    """Read a YAML file, OpenCV's dialect included; `CalibrationError` names file and place of what is wrong."""
    text = read_text(path)
    if text.startswith("%YAML"):  # OpenCV's own form of that line is no YAML
        text = "#" + text
    try:
        _require_flat(text, path)
        node = yaml.compose(text, Loader=yaml.SafeLoader)
    except yaml.YAMLError as error:
        raise CalibrationError(f"{path} is not YAML: {' '.join(str(error).split())}") from error
    return Field(None if node is None else _plain(node, path), str(path))


def _require_flat(text: str, path: Path) -> None:
    """Refuse aliases and deep nesting from the events alone, before anything is built of them."""
    level = 0
    for event in yaml.parse(text, Loader=yaml.SafeLoader):
        if isinstance(event, yaml.AliasEvent):
            raise CalibrationError(f"{path} has an alias, *{event.anchor}: write the value itself there")
        level += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
        if level > _MOST_LEVELS:
            raise CalibrationError(f"{path} is nested more than {_MOST_LEVELS} levels deep: it is no calibration")


def _plain(node: yaml.Node, path: Path) -> object:
    """Return mappings, lists, texts and numbers of a node."""
    place = f"{path} line {node.start_mark.line + 1}"
    if node.tag not in _PLAIN and not (node.tag == _MATRIX and isinstance(node, yaml.MappingNode)):
        raise CalibrationError(f"{place} has the tag {node.tag}: only plain values are read")
    if isinstance(node, yaml.MappingNode):
        return _mapping([(_key(key, path), _plain(value, path)) for key, value in node.value], path)
    if isinstance(node, yaml.SequenceNode):
        return [_plain(entry, path) for entry in node.value]
    assert isinstance(node, yaml.ScalarNode)  # there is no fourth kind
    return str(node.value) if node.style else _word(str(node.value))


def _key(node: yaml.Node, path: Path) -> str:
    if not isinstance(node, yaml.ScalarNode):
        raise CalibrationError(f"{path} line {node.start_mark.line + 1} has a key that is no word")
    return str(node.value)


def _mapping(pairs: list[tuple[str, object]], path: Path) -> dict[str, object]:
    found: dict[str, object] = {}
    for key, value in pairs:
        if key in found:
            raise CalibrationError(f"{path} has the key {key!r} twice: leave one")
        found[key] = value
    return found
