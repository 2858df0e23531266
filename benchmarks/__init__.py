"""Measurements, as ratios within one run; results are kept in RESULTS.md."""
