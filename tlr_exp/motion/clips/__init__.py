"""Authored motions, one YAML of keyframes each."""

from importlib.resources import files


def motion_names() -> list[str]:
    """The names of the authored motions."""
    found = (entry.name for entry in files("tlr_exp.motion.clips").iterdir())
    return sorted(name.removesuffix(".yaml") for name in found if name.endswith(".yaml"))
