"""Records that a run leaves behind: run directory, checkpoints, and its mirror in MLflow."""
