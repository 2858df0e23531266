"""Training by rollouts: windows, folds, trainer, acceptance on held-out windows."""
