"""From the words of YAML and of a command to checked settings."""
