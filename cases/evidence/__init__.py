"""What a folder of trials says of its own columns: frames, signs, units, lags and lever arms compete by ratios of
misfits between integrated velocities and positions, integrated turn rate and heading, turn rate and rudder.

Numbers in brackets behind constants that were set by hand are those of ``cases.checks``.
"""
