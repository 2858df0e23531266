"""The same work by other open tools: shipmmg for a simulation, SciPy and pycma for the objective of a calibration."""
