"""Names of the six states of a ship in the horizontal plane."""

# In their fixed order: m, m, rad, m/s, m/s, rad/s; x north, y east, psi clockwise, velocities over ground.
STATES = ("x", "y", "psi", "u", "v", "r")
