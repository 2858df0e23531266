"""What changes in the course of a long log, and when."""
