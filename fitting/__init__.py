"""From trajectories to coefficients with their uncertainty, and how well they predict."""
