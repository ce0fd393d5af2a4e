"""The life of a calibration after the day it was made: `check` says whether it still holds, `refine` mends what crept."""
