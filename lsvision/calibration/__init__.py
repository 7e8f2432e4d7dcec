"""Calibration of camera, laser plane and hand-eye pose, with planning of robot poses."""
