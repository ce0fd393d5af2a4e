"""How the small net of the upsampler was trained: scenes of the optical twin, and nothing else."""
