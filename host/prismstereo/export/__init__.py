"""Frames for other programs: ROS 2 bags, point clouds, meshes, 16-bit pictures, films, robot descriptions.

Every format is made of `ExportFrame`s, wherever they come from: a session folder that is matched anew, or a recording.
"""
