"""Profile to arcs: range image, candidates, rough identification, accurate screening."""
