"""How files of unknown origin are read, and how outputs are written: the ground of all readers."""
