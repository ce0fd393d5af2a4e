"""The printable target: one geometry of every board, the code that names it, and the sheets made of both.

Start at `sheet`. `pattern` gives the ink of a board, `code` that of its name tag, `sheet` places both on a page; `pdf`, `svg`
and `dxf` write it. `reading` finds out from pictures which board it is.
"""
