"""Whether the effects that were selected are named: checks on what is left and on test trials, and the verdict."""
