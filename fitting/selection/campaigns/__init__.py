"""Which instruments differ between campaigns, and by how much."""
