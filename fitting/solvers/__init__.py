"""IPOPT, several starts, and the iteration over the noise."""
