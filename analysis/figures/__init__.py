"""Figures of a study: functions from a ``Study`` to a ``Drawing``; ``catalogue`` lists them."""
