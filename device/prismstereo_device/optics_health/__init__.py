"""What glass and mirrors do to the picture after the unit was calibrated: dust, a covered half, a prism that moved.

Start reading at `health`.
"""

from __future__ import annotations

from prismstereo_device.optics_health.finding import Finding, State
from prismstereo_device.optics_health.health import OpticsHealth, OpticsReport
from prismstereo_device.optics_health.look import Look, take_look
from prismstereo_device.optics_health.watcher import OpticsWatcher

__all__ = ["Finding", "Look", "OpticsHealth", "OpticsReport", "OpticsWatcher", "State", "take_look"]
