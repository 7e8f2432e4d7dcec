"""Sensors: from an image to mm, and the noise of bought profile sensors."""
