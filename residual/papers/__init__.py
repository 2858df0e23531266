"""Networks of the literature: black boxes, ensembles, and the comparison of all models."""
