"""Fleets: many ships and campaigns, fitted, judged, diagnosed and compared in one run that can be resumed."""
