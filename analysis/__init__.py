"""From the runs of a study to its statistics, figures and report."""
