"""Ensembles beyond what the product uses: members side by side on a GPU, calibrated spread, heading keeping."""
