"""Comparison of all model families on the published splits."""
