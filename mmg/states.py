"""Names of the six states of a ship in the horizontal plane."""

STATES = ("x", "y", "psi", "u", "v", "r")
"""In their fixed order: m, m, rad, m/s, m/s, rad/s; x north, y east, psi clockwise, velocities over ground."""
