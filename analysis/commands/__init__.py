"""The commands: tlr-export and tlr-report."""
