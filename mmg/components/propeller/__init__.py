"""Propeller forces: one file per model. Each returns its slipstream for the rudder behind it."""
