"""Read and write profiles, images, robot poses, calibrations and results."""
