"""From a wish to a rig: placement, limits, sensitivities, assembly tolerances, the numbers on the box. Start at `designer`."""
