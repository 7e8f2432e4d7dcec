"""Many profiles: measured in parallel, from files to files, on one machine or several."""
