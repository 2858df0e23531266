"""A sequential quadratic method that eliminates the nodes of each window before the coefficients meet."""
