"""tlr_exp: experiment sweeps for two-layered reward learning on a humanoid."""

__version__ = "0.1.0"
