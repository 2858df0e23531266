"""Generated months of a ship in service, by two generators that share neither ship, numerics nor noise."""
