"""Build this package with colcon; what it needs of prismstereo comes with `pip install prismstereo`, which no ROS index has."""

from setuptools import setup

NAME = "prismstereo_ros"

setup(
    name=NAME,
    version="0.1.0",
    description="Single-camera stereo depth in ROS 2",
    license="Apache-2.0",
    packages=[NAME],
    install_requires=["setuptools"],
    zip_safe=True,
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/prismstereo.launch.py"]),
        (f"share/{NAME}/rviz", ["rviz/prismstereo.rviz"]),
    ],
    entry_points={"console_scripts": [f"node = {NAME}.node:main"]},
)
