"""Updates that can be trusted: a signed bundle, and the place where the system's own updater finds it."""

from prismstereo_device.update.bundle import Bundle, check, read_public_key
from prismstereo_device.update.inbox import UpdateInbox
from prismstereo_device.update.signing import write_bundle
from prismstereo_device.update.version import Version

__all__ = ["Bundle", "UpdateInbox", "Version", "check", "read_public_key", "write_bundle"]
