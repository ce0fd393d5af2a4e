"""Growing Correspondence Seeds: the paper's matcher, by the book.

A few sure correspondences grow into their neighbourhoods, best first; the final matching takes only those that beat all their
rivals by a margin, and leaves the rest unmatched. `matcher` is where to start reading.
"""
