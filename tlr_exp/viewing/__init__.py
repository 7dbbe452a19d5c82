"""Watching motions: MuJoCo's own viewer, and a viewer in the browser."""


class ViewerUnavailable(RuntimeError):
    """A viewer cannot be opened on this machine; the message says in one line what would help."""
