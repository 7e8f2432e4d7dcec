"""Views to calibration: camera, laser plane, sensor to robot; with residuals and covariance."""
