"""Simulated trials: wind, sensor noise, random controls, batches, the embedded demo."""
