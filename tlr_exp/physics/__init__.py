"""Simulation engines behind one protocol."""
