"""Manoeuvring models (MMG) of ships, calibrated from trial data."""
