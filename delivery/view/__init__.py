"""The interactive page on runs: one self-contained file with tracks, histories, bands and forces."""
