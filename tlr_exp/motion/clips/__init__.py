"""Authored motions, one YAML of keyframes each."""
