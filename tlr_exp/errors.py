"""The one base of every error that is explained to a person."""


class UserError(ValueError):
    """Something that a person asked for cannot be; the message says what, where, and what can.

    Commands print it without a traceback. All else is a fault of the program, and is shown as one.
    """
