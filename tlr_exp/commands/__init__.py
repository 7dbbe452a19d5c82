"""The commands: they read arguments, wire the parts and print."""
