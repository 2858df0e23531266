"""The run folder of a calibration, its figures and its report page."""
