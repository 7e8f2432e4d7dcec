"""Formats of files: profiles, images, robot poses, calibrations, and results."""
