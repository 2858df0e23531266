"""Where the gap lies: channels, phases, regions, frequency bands."""
