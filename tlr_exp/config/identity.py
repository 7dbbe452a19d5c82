"""Which run a configuration is: a hash of all that it learns from, the same over versions."""

from collections.abc import Mapping
from typing import Any

from tlr_exp.config.input_files import INITIAL, MODEL, MOTION, file_hashes
from tlr_exp.config.nested import value_at
from tlr_exp.config.versions import ADDED_KEYS, with_first_names
from tlr_exp.config.words import WORDS
from tlr_exp.records.runs import config_hash

# Keys that change where or how a run is made, not what it learns.
NOT_IDENTITY = (
    *("resume", "runs_dir", "tracking_uri", "study", "num_threads", "physics.num_threads"),
    *("precision", *WORDS),
    *("scale.evidence", "scale.evaluate_every", "scale.evaluate_starts"),
    *("scale.checkpoint_every", "scale.keep_checkpoints"),
)
# A key that came later has no part in the identity while it has the value that says what runs did
# before it (ADDED_KEYS), so that these keep theirs. This one has counted from its first day.
ALWAYS_IDENTITY = ("reward.penalty_scale",)


def run_identity(config: Mapping[str, Any], hashes: Mapping[str, str] | None = None) -> str:
    """8 hex digits of a plain configuration, in which files count by what they hold.

    Two runs of the same identity learn the same, wherever their files lie and whatever they are
    called. A key that came later and has the value that earlier runs had does not count.

    Args:
        config: the plain configuration.
        hashes: of its files, where what they held once counts; by default of what they hold now.

    Raises:
        FileNotFoundError: a file that the configuration names is not there.
    """
    hashes = file_hashes(config) if hashes is None else hashes
    robot = {**config["env"]["robot"], "mjcf": hashes.get(MODEL)}
    env = {**config["env"], "motion": hashes[MOTION], "robot": robot}
    counted = {**config, "env": env, INITIAL: hashes.get(INITIAL)}
    as_before = [key for key, value in _later_keys().items() if value_at(counted, key) == value]
    return config_hash(with_first_names(counted), (*NOT_IDENTITY, *as_before))


def _later_keys() -> dict[str, Any]:
    return {key: value for key, value in ADDED_KEYS.items() if key not in ALWAYS_IDENTITY}
