"""Why a picture gave no corners, in a few words that fit behind the frame's name."""

from __future__ import annotations

from dataclasses import dataclass

__all__ = ["NO_BOARD", "Refusal"]


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a picture gave no corners."""

    reason: str


NO_BOARD = Refusal("no board")
