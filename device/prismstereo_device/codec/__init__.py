"""Disparity codecs. Codec 1 (`baseline`) needs numpy and zstd only; codec 2 (`compact`) is compiled and far smaller.

The names of codec 1 are given here; whoever sends or reads codec 2 imports `prismstereo_device.codec.compact`.
"""

from __future__ import annotations

from prismstereo_device.codec.baseline import CODEC, decode_stripe, encode, rows_per_stripe

__all__ = ["CODEC", "decode_stripe", "encode", "rows_per_stripe"]
