"""Hull forces: one file per model."""
