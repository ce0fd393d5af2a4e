"""OpenCV's semi-global matcher with the one set of settings that every comparison uses."""

from __future__ import annotations

import cv2

__all__ = ["sgbm_anchor"]


def sgbm_anchor(labels: int, mode: int = cv2.STEREO_SGBM_MODE_SGBM) -> cv2.StereoSGBM:
    """Return the matcher for at least so many disparities from 0 on; OpenCV counts them in sixteens."""
    return cv2.StereoSGBM.create(
        minDisparity=0,
        numDisparities=-(-labels // 16) * 16,
        blockSize=5,
        P1=200,
        P2=800,
        disp12MaxDiff=1,
        preFilterCap=0,
        uniquenessRatio=10,
        speckleWindowSize=100,
        speckleRange=2,
        mode=mode,
    )
