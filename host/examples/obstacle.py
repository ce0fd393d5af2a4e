"""How far is the nearest thing ahead? Run with a port, a recording or `simulated`; with nothing, the sensor on USB."""

import sys

import numpy as np

import prismstereo


def nearest_mm(frame: prismstereo.CameraFrame) -> float | None:
    """Distance of the nearest hundredth of what is seen in the middle third; None where hardly anything is."""
    ahead = frame.depth_mm[:, frame.width // 3 : 2 * frame.width // 3]
    seen = ahead[np.isfinite(ahead)]
    return float(np.percentile(seen, 1)) if seen.size > 0.1 * ahead.size else None


with prismstereo.open(sys.argv[1] if sys.argv[1:] else None, queue_frames=1) as camera:
    for frame in camera:
        if frame.age_us > 300_000:  # it waited too long: the next is newer
            continue
        distance_mm = nearest_mm(frame)
        print("nothing seen" if distance_mm is None else f"{distance_mm:.0f} mm ahead", flush=True)
