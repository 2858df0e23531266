"""IPOPT, several starts, and the iteration over noise and latent forces."""
