"""What colcon installs: the node, its launch file and its parameters."""

from setuptools import setup

NAME = "evs_camera_ros"

setup(
    name=NAME,
    version="0.2.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/camera.launch.py"]),
        (f"share/{NAME}/config", ["config/camera.yaml"]),
    ],
    install_requires=["setuptools"],
    zip_safe=True,
    description="A virtual event camera for MuJoCo scenes, as a lifecycle node of ROS 2",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"camera = {NAME}.node:main"]},
)
