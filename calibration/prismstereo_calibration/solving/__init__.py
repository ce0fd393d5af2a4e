"""From corners to cameras: the lens models, the joint adjustment of all views, what is rejected on the way.

Start reading at `solve`.
"""
