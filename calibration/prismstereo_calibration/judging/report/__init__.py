"""The report of a calibration: one HTML page that needs nothing else, for a person and for a file cabinet. Start at `page`."""

from __future__ import annotations

from prismstereo_calibration.judging.report.page import html

__all__ = ["html"]
