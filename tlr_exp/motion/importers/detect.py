"""Detects the format of a file from its content."""

from collections.abc import Callable, Mapping
from typing import Any

from tlr_exp.motion.importers.files.text_table import COLUMNS, TABLE
from tlr_exp.motion.importers.formats import (
    amp,
    asap,
    beyondmimic,
    gmr,
    holosoma,
    locomujoco,
    old_locomujoco,
    own,
    protomotions,
    table,
)
from tlr_exp.motion.importers.raw import MotionFileError, Options, Recorded, listed
from tlr_exp.motion.importers.readings.columns import is_seed
from tlr_exp.robot.spec import RobotSpec

Reader = Callable[[Mapping[str, Any], Options, RobotSpec], Recorded]
READERS: dict[str, Reader] = {
    "asap": asap.read,
    "pbhc": asap.read,
    "lafan1": table.read,
    "bones-seed": table.read,
    "beyondmimic": beyondmimic.read,
    "holosoma": holosoma.read,
    "amp": amp.read,
    "gmr": gmr.read,
    "protomotions": protomotions.read,
    "protomotions-library": protomotions.read_library,
    "locomujoco": locomujoco.read,
    "locomujoco-0": old_locomujoco.read,
    "tlr": own.read,
}
# The keys by which a format is told; the first that fits, so the more special ones first.
_SIGNATURES: tuple[tuple[str, frozenset[str]], ...] = (
    ("tlr", frozenset({"fps", "qpos", "joint_names", "body_names", "body_pos_w"})),
    ("locomujoco", frozenset({"qpos", "joint_names", "frequency"})),
    ("locomujoco-0", frozenset({"q_pelvis_tx", "q_pelvis_ty", "q_pelvis_tz"})),
    ("holosoma", frozenset({"joint_pos", "joint_names"})),
    ("beyondmimic", frozenset({"joint_pos", "body_pos_w", "body_quat_w"})),
    ("amp", frozenset({"dof_positions", "dof_names", "body_positions", "body_rotations"})),
    ("protomotions", frozenset({"dof_pos", "rigid_body_pos", "rigid_body_rot"})),
    ("protomotions-library", frozenset({"gts", "grs", "dps", "motion_num_frames"})),
    ("gmr", frozenset({"root_pos", "root_rot", "dof_pos"})),
    ("pbhc", frozenset({"root_trans_offset", "dof", "root_rot", "contact_mask"})),
    ("asap", frozenset({"root_trans_offset", "dof", "root_rot"})),
    ("lafan1", frozenset({TABLE})),
)


def detect(content: Mapping[str, Any]) -> str:
    """The name of the format, one of ``READERS``.

    Raises:
        MotionFileError: none fits.
    """
    motions = []
    if isinstance(content, dict):
        motions = [value for value in content.values() if isinstance(value, dict)]
    keys = list(motions[0] if motions else content)
    if COLUMNS in content and is_seed(content[COLUMNS]):
        return "bones-seed"
    for name, signature in _SIGNATURES:
        if signature <= set(keys):
            return name
    raise MotionFileError(
        f"its format is not known; it has {listed(keys)}; known are {', '.join(READERS)}"
    )
