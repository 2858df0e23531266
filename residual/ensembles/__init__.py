"""Ensembles of hybrids: trajectory sampling, calibrated spread, heading keeping."""
