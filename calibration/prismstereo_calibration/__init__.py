"""What was MEASURED of a unit: cameras, rectification, detection, solving, files. Start at `model`."""
