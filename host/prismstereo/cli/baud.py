"""The speed of a real UART, an option of every verb that opens a sensor."""

from __future__ import annotations

import click

__all__ = ["baud_option"]

baud_option = click.option(
    "--baud",
    type=click.IntRange(1200, 50_000_000),
    help="Speed of a real UART (921600 unless said); USB and TCP need none.",
)
