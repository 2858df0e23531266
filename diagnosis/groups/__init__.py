"""What differs between groups of trials, and what changes in the course of a long log."""
