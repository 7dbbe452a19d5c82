"""Words that name sets of values: ``recipe``, ``curriculum`` and ``reading``.

A run records its words. What it learns from are the values behind them.
"""

from collections.abc import Mapping

# The keys and groups that the choices of each word (conf/recipe and so on) set.
WORDS: Mapping[str, tuple[str, ...]] = {
    "recipe": (
        *("ppo", "env.observation", "env.action", "env.reference_lead", "env.start_phase"),
        "env.termination",
    ),
    "curriculum": ("stages", "optimizer"),
    "reading": ("reward", "optimizer", "env.termination", "env.robot", "ppo.std"),
}
