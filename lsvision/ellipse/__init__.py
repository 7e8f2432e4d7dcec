"""Ellipse of an arc: parameters, smoothing, fit, priors, intervals and the result."""
