"""Base of all results: numbers with units and sigmas as tables, records, frames and pictures."""
