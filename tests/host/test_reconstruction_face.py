from __future__ import annotations

import numpy as np
import pytest

from host.reconstructed_faces import face_frames, of_width, tally
from prismstereo_hw.rig import Rig

FACE_MM = 0.5  # mean distance of a reconstructed face from the true one


def test_a_speaking_face_is_reconstructed_to_half_a_millimetre(dslr: Rig) -> None:
    """Half the pixels each way: 100 frames of the whole picture are the soak's."""
    found = tally(face_frames(of_width(dslr, 640, 360), 3, every=8))
    assert max(found.raw_mm) <= FACE_MM, found
    assert max(found.steady_mm) <= FACE_MM, found
    assert found.flicker_steady_mm <= found.flicker_raw_mm, found
    assert 0.6 <= found.pull <= 1.5, found


@pytest.mark.soak
def test_a_hundred_frames_of_a_speaking_face(dslr: Rig) -> None:
    found = tally(face_frames(dslr, 100))
    print(
        f"\n{'face, dslr-35mm, 100 frames':32}{'mean error mm':>14}{'worst frame':>12}{'moving parts':>13}{'flicker':>9}"
    )
    rows = (
        ("unsmoothed", found.raw_mm, found.moving_raw_mm, found.flicker_raw_mm),
        ("steady", found.steady_mm, found.moving_steady_mm, found.flicker_steady_mm),
    )
    for name, errors, moving, flicker in rows:
        print(f"{name:32}{np.mean(errors):14.3f}{max(errors):12.3f}{np.mean(moving):13.3f}{flicker:9.4f}")
    print(f"told sigma {found.told_mm:.3f} mm, error / sigma at 68 % {found.pull:.2f}")
    assert max(found.steady_mm) <= FACE_MM, found
    assert found.flicker_steady_mm <= found.flicker_raw_mm, found
    assert np.mean(found.moving_steady_mm) <= 1.1 * np.mean(found.moving_raw_mm), found
