"""The same work by other open tools: shipmmg for a simulation, SciPy for the objective of a calibration."""
