"""What the data determine: shares of the prior, shared combinations, verdicts per coefficient."""
