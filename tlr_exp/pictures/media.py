"""Pictures and videos on disk, each whole or not there at all."""

import io
import os
import subprocess
import tempfile
from collections.abc import Iterable
from itertools import chain
from pathlib import Path

import imageio_ffmpeg
import numpy as np
from matplotlib.figure import Figure
from PIL import Image

from tlr_exp.errors import UserError
from tlr_exp.records.locks import ELSEWHERE
from tlr_exp.records.storage import atomic_write, storage_errors, temporary_name

FIGURE_DPI = 110


def write_video(path: str | Path, frames: Iterable[np.ndarray], fps: float) -> Path:
    """Write frames as an H.264 MP4, whole or not at all.

    Args:
        path: the file, which is replaced where it exists; its folder must exist.
        frames: uint8 [height, width, 3] each, of one size with even sides.
        fps: frames a second.

    Raises:
        ValueError: no frame, or frames of odd or of different size.
        StorageError: the encoder failed (a full disk, say); the message holds its words.
    """
    path = Path(path)
    frames = iter(frames)
    # The first frame comes before the file: where nothing can be drawn, nothing is written.
    first = next(frames, None)
    if first is None:
        raise UserError(f"{path}: a video needs at least one frame")
    height, width = first.shape[:2]
    if height % 2 or width % 2:
        raise UserError(f"{path}: width and height must be even, not {width} x {height}")
    temporary = temporary_name(path)
    try:
        with storage_errors(f"cannot write {path}", ELSEWHERE):
            _encode(temporary, chain([first], frames), first.shape, fps)
            os.replace(temporary, path)
    finally:
        temporary.unlink(missing_ok=True)
    return path


def write_image(path: str | Path, image: np.ndarray) -> Path:
    """Write uint8 [height, width, 3] as a PNG, whole or not at all.

    Raises:
        StorageError: a full disk, a read-only folder, ...
    """
    buffer = io.BytesIO()
    Image.fromarray(image).save(buffer, format="png")
    atomic_write(Path(path), buffer.getbuffer())
    return Path(path)


def write_figure(path: str | Path, figure: Figure) -> Path:
    """Write a figure as a PNG, whole or not at all.

    Raises:
        StorageError: a full disk, a read-only folder, ...
    """
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=FIGURE_DPI)
    atomic_write(Path(path), buffer.getbuffer())
    return Path(path)


def _encode(path: Path, frames: Iterable[np.ndarray], shape: tuple[int, ...], fps: float) -> None:
    height, width = shape[:2]
    source = ["-f", "rawvideo", "-pix_fmt", "rgb24", "-s", f"{width}x{height}", "-r", f"{fps:g}"]
    target = ["-an", "-c:v", "libx264", "-pix_fmt", "yuv420p", "-crf", "20"]
    command = [imageio_ffmpeg.get_ffmpeg_exe(), "-y", "-loglevel", "error", *source, "-i", "-"]
    with tempfile.TemporaryFile() as log:
        encoder = subprocess.Popen(
            [*command, *target, "-movflags", "+faststart", "-f", "mp4", str(path.absolute())],
            stdin=subprocess.PIPE,
            stdout=log,
            stderr=log,
        )
        assert encoder.stdin is not None
        try:
            for frame in frames:
                if frame.shape != shape:
                    raise UserError(f"a frame of {frame.shape} among video frames of {shape}")
                encoder.stdin.write(np.ascontiguousarray(frame, dtype=np.uint8))
            encoder.stdin.close()
            failed = encoder.wait() != 0
        except BrokenPipeError:
            failed = True
        finally:
            encoder.kill()
            encoder.communicate()
        if failed:
            log.seek(0)
            words = log.read().decode(errors="replace").strip()
            raise OSError(f"the video encoder failed: {words}")
