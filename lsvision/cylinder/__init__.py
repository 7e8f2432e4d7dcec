"""Fit of a cylinder to points in space, and one section's cylinder in the robot's frame."""
