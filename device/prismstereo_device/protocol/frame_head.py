"""Fragment 0 of a frame: what its stripes need to become a disparity map again."""

from __future__ import annotations

import math
import struct
from dataclasses import dataclass
from typing import ClassVar, Self

from prismstereo_calibration.window import DisparityWindow
from prismstereo_device.codec.tables import BOUNDS
from prismstereo_device.protocol.body import read_fields
from prismstereo_device.wire import LIMITS, WireError

__all__ = ["FRACTION_BITS", "HEAD_SIZE", "DisparityHead"]

FRACTION_BITS = 4  # a step is 1/16 px
_LENS_UNKNOWN = -1
_APART = 0x8000  # the tables are not in this packet


@dataclass(frozen=True, slots=True)
class DisparityHead:
    """Size, coding and meaning of one frame.

    `timestamp_us` is the device's clock at mid-exposure, `calibration_hash` the first 4 bytes of the calibration's,
    `near` the codec's largest error in steps (0: exact), `filter_set` which filters ran, `table` the codec's own tables, or
    `table_apart` their size where they follow in packets of their own. The window's offset and scale travel as 32-bit floats.
    """

    frame: int
    timestamp_us: int
    width: int
    height: int
    codec: int
    stripe_rows: int
    stripes: int
    calibration_hash: bytes
    window: DisparityWindow
    lens_position: int | None = None
    filter_set: int = 0
    near: int = 0
    table: bytes = b""
    table_apart: int = 0

    _LAYOUT: ClassVar[struct.Struct] = struct.Struct("<IQHHBBBBH4sHffiHH")

    def pack(self) -> bytes:
        """Give the body's bytes."""
        return (
            self._LAYOUT.pack(
                self.frame,
                self.timestamp_us,
                self.width,
                self.height,
                self.codec,
                FRACTION_BITS,
                self.near,
                self.stripe_rows,
                self.stripes,
                self.calibration_hash,
                self.window.labels,
                self.window.offset_px,
                self.window.scale_px,
                _LENS_UNKNOWN if self.lens_position is None else self.lens_position,
                self.filter_set,
                (self.table_apart | _APART) if self.table_apart else len(self.table),
            )
            + self.table
        )

    @classmethod
    def unpack(cls, body: bytes) -> Self:
        """Read a head and hold it against every limit; raises WireError."""
        fields = read_fields(cls._LAYOUT, body, "a frame head")
        frame, timestamp_us, width, height, codec, fraction_bits, near, stripe_rows, stripes, name = fields[:10]
        labels, offset_px, scale_px, lens_position, filter_set, table_length = fields[10:]
        if fraction_bits != FRACTION_BITS:
            raise WireError(f"frame {frame} has {fraction_bits} fraction bits: version 1 has {FRACTION_BITS}")
        if not (math.isfinite(offset_px) and math.isfinite(scale_px) and scale_px >= 0):
            raise WireError(f"frame {frame} has offset {offset_px}, scale {scale_px}: finite, the scale not negative")
        apart = table_length & ~_APART if table_length & _APART else 0
        due = 0 if table_length & _APART else table_length
        table = body[cls._LAYOUT.size : cls._LAYOUT.size + due]
        if len(table) != due:
            raise WireError(f"frame {frame} announces a table of {due} bytes and has {len(table)}")
        head = cls(
            frame,
            timestamp_us,
            width,
            height,
            codec,
            stripe_rows,
            stripes,
            name,
            DisparityWindow(labels, offset_px, scale_px),
            None if lens_position < 0 else lens_position,
            filter_set,
            near,
            table,
            apart,
        )
        head.check()
        return head

    def check(self) -> None:
        """Raise WireError where a number is beyond the limits or the stripes do not cover the frame exactly."""
        if not (1 <= self.width <= LIMITS.frame_side and 1 <= self.height <= LIMITS.frame_side):
            raise WireError(f"frame {self.frame} is {self.width} x {self.height}: 1 to {LIMITS.frame_side} each")
        rows = self.stripe_rows
        if not 1 <= rows * self.width <= LIMITS.stripe_pixels:
            raise WireError(f"frame {self.frame} has stripes of {rows} rows: 1 to {LIMITS.stripe_pixels} pixels each")
        if self.stripes != -(-self.height // rows) or self.stripes > LIMITS.stripes:
            raise WireError(f"frame {self.frame} has {self.stripes} stripes of {rows} rows for {self.height} rows")
        if self.near not in BOUNDS:
            raise WireError(f"frame {self.frame} has a bound of {self.near} steps: it is one of {BOUNDS}")
        if max(len(self.table), self.table_apart) > LIMITS.table:
            raise WireError(
                f"frame {self.frame} has tables of {max(len(self.table), self.table_apart)} bytes: at most {LIMITS.table}"
            )

    def rows_of(self, stripe: int) -> int:
        """Give the height of one stripe, 0-based; only the last may be lower than the others."""
        return min(self.stripe_rows, self.height - stripe * self.stripe_rows)


HEAD_SIZE = DisparityHead._LAYOUT.size  # bytes, tables left out
