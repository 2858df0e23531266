"""Faults of trial files that a generator of its own makes, judged and mended from files on disk as by a user."""
