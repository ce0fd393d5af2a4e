"""Filters between matching and the wire: named chains of small steps, and the reason of every unmatched pixel.

Start at `chain`. What is unmatched stays unmatched, unless a chain ends with `holes`, which marks what it fills.
"""

from __future__ import annotations

from prismstereo_device.filters.chain import PRESETS, AnyFilter, FilterChain, FilterStream, chain
from prismstereo_device.filters.explanation import explained
from prismstereo_device.filters.warm_up import warm_up

__all__ = ["PRESETS", "AnyFilter", "FilterChain", "FilterStream", "chain", "explained", "warm_up"]
