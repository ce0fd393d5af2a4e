"""Who the camera is on the wire."""

from __future__ import annotations

from dataclasses import dataclass

from prismstereo_device.wire import WireError

__all__ = ["DeviceIdentity"]


@dataclass(frozen=True, slots=True)
class DeviceIdentity:
    """Who the camera is: 8 bytes for life, and a 32-bit number drawn at each start."""

    device_id: bytes
    boot_id: int

    def __post_init__(self) -> None:
        """Refuse what the wire cannot carry."""
        if len(self.device_id) != 8 or not 0 <= self.boot_id <= 0xFFFF_FFFF:
            raise WireError(
                f"device id {self.device_id.hex()}, boot id {self.boot_id}: the one has 8 bytes, the other 32 bits"
            )
