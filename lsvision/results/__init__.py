"""What results share: numbers with units and sigmas as tables, records, frames and pictures."""
