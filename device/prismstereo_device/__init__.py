"""What RUNS on the camera: sensors, split, rectify, match, codec, protocol, links, service. Start at `pipeline`."""
