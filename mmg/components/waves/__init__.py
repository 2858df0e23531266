"""Wave forces: one file per model."""
