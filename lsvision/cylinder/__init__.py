"""Cylinder through points of several sections, and its pose in the robot's frame."""
