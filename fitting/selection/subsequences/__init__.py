"""Identification as Miyauchi et al. (2023) do it: their objective over simulated subsequences, and two optimisers."""
