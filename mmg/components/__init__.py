"""The component models of a ship, in a folder for each role, and the tables of their coefficients."""
