"""What a folder of trials says of its own columns: frames, signs, units, lags and lever arms compete by ratios of
misfits between integrated velocities and positions, integrated turn rate and heading, turn rate and rudder.

Constants of this room that name no source are set by hand; ``benchmarks.file_faults`` measures what they do together.
"""
