"""The report of a study: the paper's claims beside ours, figures, statistics, cost."""
