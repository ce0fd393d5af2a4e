"""Learned matchers: any stereo network in an ONNX file, run by onnxruntime. Nothing is bundled: bring the file.

`request` reads what was asked for, `presets` how families of networks want their pictures, `model_shape` what the file
itself says, `fitting` and `tensors` make the pictures fit, `disparity_output` finds the map in what comes back, `session` runs
the file, and `onnx` is the matcher.
"""

from __future__ import annotations
