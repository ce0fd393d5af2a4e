"""How good a calibration is and what to do next: figures, uncertainty in mm, verdict, report.

Start reading at `quality`.
"""
