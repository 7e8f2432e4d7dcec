"""Robust estimates, autocorrelation, quantiles, least squares, and markers of lost points."""
