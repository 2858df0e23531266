"""Roll as a fourth degree of freedom."""
