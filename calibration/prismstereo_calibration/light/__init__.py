"""What pictures tell of the unit besides geometry: the seam, the light of both views, pixels that never match.

Start reading at `seam`.
"""
