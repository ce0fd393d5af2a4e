"""Boards and where they are seen: what a board is, its corners in every view of every frame, and why others do not count.

Start reading at `detect`.
"""
