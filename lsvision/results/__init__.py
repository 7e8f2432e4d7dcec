"""Base of all results: numbers with units and std as tables, records, data frames and pictures."""
