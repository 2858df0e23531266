"""Instruments against kinematics: heading against turn rate, position against velocity."""
