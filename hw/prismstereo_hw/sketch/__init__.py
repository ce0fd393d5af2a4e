"""Drawings of rigs as SVG: `drawing` of a prism rig with its dimensions, `ray_drawing` of any kind."""
