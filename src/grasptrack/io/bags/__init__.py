# SPDX-License-Identifier: Apache-2.0
"""Recordings of robots as sources: ROS 1 and ROS 2 bags, and MCAP files of ROS, Foxglove or our own."""
