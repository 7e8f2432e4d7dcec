"""Robust estimates and autocorrelation."""
