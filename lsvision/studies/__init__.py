"""Studies of published methods."""
