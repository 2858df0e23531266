"""Faults of trial files made by a generator of their own, judged and mended as a user would do it, from files on disk."""
