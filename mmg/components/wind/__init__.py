"""Wind forces: one file per model."""
