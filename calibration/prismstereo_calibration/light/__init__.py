"""What pictures tell of the unit besides geometry: the seam, the light of both views, pixels that never match.

Start reading at `flat_field`. The seam itself is in `prismstereo_calibration.seam`, since a camera looks for it, too.
"""
