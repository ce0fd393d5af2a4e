"""Rectification without a board: from points that both views of any scene show. No scale, no millimetres."""
