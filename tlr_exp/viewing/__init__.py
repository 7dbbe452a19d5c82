"""Watching motions: MuJoCo's own viewer, and a viewer in the browser."""

from tlr_exp.errors import UserError


class ViewerUnavailable(UserError):
    """A viewer cannot be opened on this machine; the message says in one line what would help."""
