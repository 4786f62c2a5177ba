# SPDX-License-Identifier: Apache-2.0
"""As colcon builds it; grasptrack itself is installed by pip beforehand."""

from setuptools import setup

NAME = "grasptrack_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", ["launch/track.launch.py", "launch/servo.launch.py"]),
        (f"share/{NAME}/config", ["config/track.yaml", "config/servo.yaml"]),
    ],
    install_requires=["setuptools"],
    license="Apache-2.0",
    entry_points={
        "console_scripts": [
            "tracker = grasptrack_ros.tracker_node:main",
            "servo = grasptrack_ros.servo_node:main",
        ]
    },
)
