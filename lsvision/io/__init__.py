"""The only modules that read and write files."""
