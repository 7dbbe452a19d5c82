"""mink without jax: ``from tlr_exp.motion.authoring.mink_alone import mink``.

mink's QP layer, qpsolvers, imports every solver that it finds installed, one of them with jax. That
costs a second, and jax must not be loaded before its own room, physics/mjx.py, has configured it.
qpsolvers goes on without a solver whose import fails.
"""

import sys

_hide = "jax" not in sys.modules
if _hide:
    sys.modules["jax"] = None  # pyright: ignore[reportArgumentType]
try:
    import mink
finally:
    if _hide:
        del sys.modules["jax"]

__all__ = ["mink"]
