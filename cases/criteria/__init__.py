"""Figures of manoeuvres (advance, overshoot, stopping distance, ...) and the IMO criteria they are judged by."""
