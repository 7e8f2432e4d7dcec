"""Batches of profile files, measured in parallel on one machine or several."""
