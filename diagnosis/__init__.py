"""Where the sim-to-real gap lies and which effect causes it. Nothing is here yet: calibration comes first."""
