"""Parameter sets of other simulators: the ship projected on their form by least squares, with the error said."""
