"""What the instrument IS: rig, optics, scenes, the optical twin, session folders. Start at `rig`."""
