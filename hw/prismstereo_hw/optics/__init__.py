"""What light does in the rig: `unfold` is the exact closed form, `trace` the same ray by ray, `figures` what follows."""
