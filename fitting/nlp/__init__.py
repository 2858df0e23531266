"""The nonlinear program: grids, windows, shooting intervals, costs, priors, measurement effects, information."""
