"""Taylor expansion of the forces about rest: one polynomial for any actuators, its terms made by rules.

The Abkowitz-MMG hybrid of Miyauchi et al. (2023).
"""
