"""A calibration in the words of others, there and back: ROS, OpenCV, Kalibr, Luxonis, COLMAP. Start at `pair`."""
