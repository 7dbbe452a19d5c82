"""How well a motion was tracked: roll-outs without exploration noise, and their measures.

``rollout.py`` lets a policy act, and ``trajectory.py`` is what that leaves. The measures are pure
functions of it: ``distances.py``, ``latency.py``, ``effort.py``, ``endings.py``. ``result.py``
takes them together; ``measures.py`` says how each is called and printed.
"""
