"""Sister ships: coefficients that are drawn from one distribution, whose mean and width the fits of all of them say."""
