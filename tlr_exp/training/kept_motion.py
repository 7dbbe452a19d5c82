"""The motion of a run, kept beside what was learned from it.

What `env.motion` names may be edited or moved later, and the code that builds clips may change.
"""

from tlr_exp.motion.clip import MotionClip
from tlr_exp.records.locks import ELSEWHERE
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.records.storage import storage_errors, sync_file, sync_folder


def kept_motion(run: RunDirectory, clip: MotionClip) -> MotionClip:
    """The clip that the run keeps; where it keeps none, `clip`, which is kept then.

    Raises:
        ValueError: the file that is there is no clip.
        StorageError: the file cannot be written.
    """
    path = run.motion_path
    if path.exists():
        return MotionClip.load(path, clip.spec)
    with storage_errors(f"cannot write {path}", ELSEWHERE):
        clip.save(path)
        sync_file(path)
        sync_folder(path.parent)
    return clip
