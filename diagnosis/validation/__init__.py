"""Held-out trials: how far the gap shrinks, and a learned residual of what is left."""
