"""Rudder forces: one file per model."""
