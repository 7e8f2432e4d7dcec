"""The line that a laser plane draws, located in a camera image to a fraction of a pixel."""
