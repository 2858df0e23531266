"""The ship as a functional mock-up unit (FMI 2.0 and 3.0 co-simulation)."""
