"""A ROS 2 node around `prismstereo.StereoCamera`; what messages hold is decided in `prismstereo.export`."""
