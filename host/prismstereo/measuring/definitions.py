"""What each figure of depth quality means, in the words that stand beside it in every report."""

from __future__ import annotations

from prismstereo.measuring.flat_target import ROI_SHARE
from prismstereo.measuring.levels import LEAST_SHARE
from prismstereo.measuring.truth_bins import INLIER_PX

__all__ = ["DEFINITIONS"]

DEFINITIONS: dict[str, str] = {
    "region": f"Unless another is given, the middle {100 * ROI_SHARE:.0f} % of the rectified left picture, each way. All "
    "figures of a flat target are of its pixels.",
    "fill_percent": "Pixels of the region with a depth, of all its pixels. What a filter filled in has none.",
    "plane": "Total least squares through the centroid of the points, after half a per cent of them was dropped at either end "
    "of their depths. Frame: the rectified left camera.",
    "distance_mm": "From the left pinhole to the plane, square to it. The true distance is meant in the same way.",
    "plane_rms_mm": "Spatial noise: the root of the mean square of the distances of those points from the plane; also in per "
    "cent of the distance.",
    "subpixel_rms_px": "The same error as disparity: root mean square of F / Z - F / Zp, where F is focal length times "
    "baseline, Z the depth of a point along the optical axis, and Zp that of its foot on the plane.",
    "expected_rms_mm": "What the sub-pixel RMS is worth at that distance: Z^2 / F times it.",
    "z_accuracy_percent": "Median of the points' depths, the plane turned to be parallel to the true one, less the true "
    "distance, in per cent of it; + is too far. Mean over the frames.",
    "temporal_noise_mm": "Median over pixels of the standard deviation of depth over the frames, of pixels matched in all of "
    "them; the number of frames stands beside it. Two frames are needed, ten are better.",
    "temporal_rms_mm": "The same, as the root of the mean variance: where matches come in steps of a sixteenth of a pixel, "
    "most pixels may rest on one step, and their median is zero.",
    "plane_fit_mm": "As in table 1 of the paper: the plane that at least 90 % of the points agree on (500 trials, 3 refits), "
    "and mean and variance of the absolute distances of ALL points from it; inlier_mean is that of the nearest 90 %.",
    "triangulation_gap_mm": "Features localised in each view by itself; mean and variance of the shortest distance between "
    "their two rays, those beyond five sigma of the others left out. The rays of one row of a dense map always meet, so it "
    "cannot be told from one. It is blind to errors of depth.",
    "levels": f"Whole disparities, by rounding, that at least {100 * LEAST_SHARE:g} % of the matched pixels have.",
    "by_distance": f"Against the known depth: share of pixels matched of those with a match in truth; share of matches more "
    f"than {INLIER_PX:g} px off; errors of the others. Predicted: what their disparity error is worth as depth. If the depth "
    "error is another one, a scale, an offset or a baseline is wrong.",
}
