"""What all the work of the tool takes on this machine, in one table, beside what it took before."""
