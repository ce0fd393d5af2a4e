"""Presets: the conventions of known families of networks, by name, or recognised by the file's name and its nodes."""

from __future__ import annotations

from collections.abc import Iterable
from functools import cache
from importlib import resources
from pathlib import Path
from types import MappingProxyType

import msgspec

from prismstereo_device.match.learned.convention import Convention

__all__ = ["Preset", "presets", "recognised"]


class Preset(Convention, frozen=True, kw_only=True, forbid_unknown_fields=True):
    """A convention, what it is about, and what a file of the family is known by."""

    about: str
    licence: str
    words: tuple[str, ...] = ()
    nodes: tuple[str, ...] = ()

    def likeness(self, path: Path, nodes: Iterable[str]) -> int:
        """Count what speaks for this family in the names of the file, its folder and its nodes; 0 where nothing does."""
        name = f"{path.parent.name}/{path.name}".lower()
        by_words = len(self.words) if all(word in name for word in self.words) else 0
        by_nodes = 1 if self.nodes and set(self.nodes) <= set(nodes) else 0
        return by_words + by_nodes


@cache
def presets() -> MappingProxyType[str, Preset]:
    """Return the presets by name, in the order of the file they come from."""
    text = resources.files("prismstereo_device.match.learned").joinpath("presets.toml").read_text("utf-8")
    return MappingProxyType(msgspec.toml.decode(text, type=dict[str, Preset]))


def recognised(path: Path, nodes: Iterable[str]) -> str | None:
    """Return the name of the preset that a file is most like, or None where nothing speaks for any."""
    names = tuple(nodes)
    name, preset = max(presets().items(), key=lambda item: item[1].likeness(path, names))  # the first of equals
    return name if preset.likeness(path, names) else None
