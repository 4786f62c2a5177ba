# SPDX-License-Identifier: Apache-2.0
"""grasptrack in ROS 2. What decides anything (`tracking`, `grasptrack.servo.steering`) knows no ROS; nodes pass messages on."""
