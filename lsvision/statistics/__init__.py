"""Robust estimates, autocorrelation, quantiles, and markers of lost points."""
