"""Torch networks on top of a calibrated ship. Nothing is here yet: the calibrated ship comes first."""
