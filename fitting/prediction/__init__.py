"""Open-loop prediction of windows: adaptation, bands, scores."""
