"""Everything particular: ships, trial files, manoeuvres, published splits, synthetic trials."""
