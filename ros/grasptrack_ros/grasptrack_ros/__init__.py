# SPDX-License-Identifier: Apache-2.0
"""grasptrack in ROS 2. What decides anything (`tracking`, `steering`) knows no ROS; nodes only pass messages on."""
