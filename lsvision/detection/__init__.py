"""Detection of the arcs of cylinders in a profile (paper section 3.2)."""
