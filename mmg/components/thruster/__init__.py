"""Thrusters beside the main propeller: tunnel thrusters at bow and stern, and azimuth thrusters."""
