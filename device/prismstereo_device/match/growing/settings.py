"""The parameters of Growing Correspondence Seeds, under the names under which they were published."""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import MappingProxyType

from prismstereo_hw.errors import UsageError

__all__ = ["PRESETS", "GrowingSettings"]

_MOST_HYPOTHESES = 64
_MOST_SEEDS = 1_000_000


@dataclass(frozen=True, slots=True)
class GrowingSettings:
    """What growing and the final matching go by; correlations are -1..1. `UsageError` for what cannot be.

    Growing. `tau`: a hypothesis correlates at least so well (-inf: whatever it correlates). `mu`: growth ends where one is
    beaten by more than this on its left and on its right pixel; 0 grows greedily. `max_hypotheses`: on one left pixel.
    `dgrow0`: the baseline, one hypothesis per pixel and no second thought; `epsilon`: how far, there, the best of a
    neighbourhood must stand above the second best.

    Final matching. `beta`: a match stands above its rivals by this margin; 0 is plain dominance. `zonegap`: rivals within so
    many pixels of disparity belong to the same peak and need no margin. `ordering`: points keep their order along a row, so
    rivals are also those that cross.

    Seeds. `seeds`: "harris" for `harris_share` of the Harris corners that find a partner above `seed_correlation`, or "random"
    for `random_seeds` hypotheses drawn by `random_seed`. Seeds change the time more than the result: growth decides them anew.

    `noise_grey`: sigma of the noise that is expected of a pixel; flat windows correlate little. 0: the bare correlation.
    """

    tau: float = 0.6
    mu: float = 0.1
    beta: float = 0.1
    zonegap: int = 3
    max_hypotheses: int = 10
    ordering: bool = False
    dgrow0: bool = False
    epsilon: float = 0.0
    seeds: str = "harris"
    harris_share: float = 0.1
    seed_correlation: float = 0.9
    random_seeds: int = 20_000
    random_seed: int = 2007
    noise_grey: float = 1.1

    def __post_init__(self) -> None:
        """Refuse what cannot be."""
        if not (self.tau == -math.inf or -1 <= self.tau <= 1):
            raise UsageError(f"tau is {self.tau}: give a correlation of -1 to 1, or -inf for any")
        for name in ("mu", "beta", "epsilon"):
            if not 0 <= getattr(self, name) <= 2:
                raise UsageError(f"{name} is {getattr(self, name)}: give a difference of correlations, 0 to 2")
        for name in ("harris_share", "seed_correlation"):
            if not 0 <= getattr(self, name) <= 1:
                raise UsageError(f"{name} is {getattr(self, name)}: give 0 to 1")
        for name, least, most in (
            ("zonegap", 0, 1024),
            ("max_hypotheses", 1, _MOST_HYPOTHESES),
            ("random_seeds", 0, _MOST_SEEDS),
            ("random_seed", 0, 2**63),
        ):
            if not least <= getattr(self, name) <= most:
                raise UsageError(f"{name} is {getattr(self, name)}: give {least} to {most}")
        if not 0 <= self.noise_grey <= 255:
            raise UsageError(f"noise_grey is {self.noise_grey}: give a sigma of 0 to 255 grey levels")
        if self.seeds not in ("harris", "random"):
            raise UsageError(f'seeds are {self.seeds!r}: give "harris" or "random"')


PRESETS = MappingProxyType(
    {
        "published": GrowingSettings(),
        "dense": GrowingSettings(tau=0.4, mu=0.05, beta=0.05),  # what a real camera's pictures allow
        "random": GrowingSettings(tau=-math.inf, seeds="random"),
        "dgrow0": GrowingSettings(dgrow0=True),
    }
)
