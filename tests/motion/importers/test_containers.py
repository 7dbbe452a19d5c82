"""What is no motion is called by its name, and what an archive of torch holds is read as data."""

import enum
import io
import sys
import types
import zipfile

import numpy as np
import pytest
import torch
from foreign_files import gmr_motion
from test_hostile import LIMIT, touch_by_eval
from wild_files import proto_library, proto_motion, to_torch

from tlr_exp.motion.importers.convert import import_motion
from tlr_exp.motion.importers.files.torch_archive import load_torch
from tlr_exp.motion.importers.raw import MotionFileError, Options

LFS = b"version https://git-lfs.github.com/spec/v1\noid sha256:12\nsize 132\n"


def a_zip(**files: bytes) -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w") as archive:
        for name, data in files.items():
            archive.writestr(name, data)
    return file.getvalue()


def npy(array: np.ndarray) -> bytes:
    file = io.BytesIO()
    np.save(file, array)
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (LFS, "it is a Git LFS pointer, not the file: fetch the file itself"),
        (b"HIERARCHY\nROOT Hips\n{\n", "it is a BVH; .*retarget it first"),
        (b"Kaydara FBX Binary  \x00", "it is an FBX"),
        (b"\n<!DOCTYPE html><html>", "it is a web page"),
        (b'{"fps": 30, "frames": [1, 2]}', "it is JSON"),
        (b"<mujoco model='g1'>", "it is a MuJoCo model"),
        (b"\x89HDF\r\n\x1a\n" + bytes(20), "it is an HDF5 file"),
        (b"hello, I am a text\nand no table\n", "it is a text, but no table of numbers: it begins"),
        (a_zip(readme=b"hello"), "zip archive without arrays"),
        (npy(np.zeros((5, 4, 3))), r"a single array \(.npy\), \[5, 4, 3\]; expected a table"),
        (npy(np.zeros((5, 6))), "it has 6 columns; expected 36"),
        (npy(np.zeros((5, 36)))[:100], "no intact .npy file"),
        (to_torch([torch.zeros(3)]), "an archive of torch, but of no motion"),
        (to_torch({"weights": torch.zeros(3)}), "its format is not known; it has weights"),
        (
            to_torch({"a": torch.zeros(3)}, _use_new_zipfile_serialization=False),
            "torch from before 1.6",
        ),
        (b"\x80\x04\x95\x00", "no intact pickle"),
    ],
)
def test_what_is_no_motion_is_called_by_its_name(data, message, written, robot):
    with pytest.raises(MotionFileError, match=message):
        import_motion(written(data), robot)


def test_tensors_as_torch_reads_them():
    numbers = torch.arange(24.0).reshape(2, 3, 4)
    content = {
        "plain": numbers,
        "turned": numbers.permute(2, 0, 1),
        "part": numbers[1, 1:, ::2],
        "half": numbers.half(),
        "bfloat16": numbers.bfloat16(),
        "long": torch.arange(5),
        "bool": torch.tensor([True, False]),
        "empty": torch.zeros(0, 3),
        "scalar": torch.tensor(50.0),
        "double": numbers.double(),
        "text": "walk",
        "nothing": None,
        "files": ("a", "b"),
    }
    ours = load_torch(to_torch(content), LIMIT)
    for key, value in content.items():
        if isinstance(value, torch.Tensor):
            expected = value.float().numpy() if key == "bfloat16" else value.numpy()
            np.testing.assert_array_equal(ours[key], expected, strict=True)
        else:
            assert ours[key] == value


@pytest.mark.parametrize("place", ["beside", "instead"])
def test_nothing_of_an_archive_runs(place, written, tmp_path, robot, short_clip):
    mark = tmp_path / "it_ran"
    hostile = touch_by_eval(mark)
    content = proto_motion(short_clip) | {"extra": hostile} if place == "beside" else hostile
    path = written(to_torch(content))
    with pytest.raises(MotionFileError, match=r"__builtin__.eval.*nothing in it was run"):
        import_motion(path, robot)
    assert not mark.exists()
    torch.load(path, weights_only=False)  # the file is really hostile
    assert mark.exists()


def test_tensors_beyond_their_storage_are_refused():
    """An expanded tensor may be larger than any memory."""
    with pytest.raises(MotionFileError, match="no intact"):
        load_torch(to_torch({"a": torch.zeros(1).expand(1 << 40)}), LIMIT)
    with pytest.raises(MotionFileError, match="unpacks to more than 1 MiB"):
        load_torch(to_torch({"a": torch.zeros(1 << 20)}), LIMIT)


def test_a_program_of_torch(written, robot):
    data = a_zip(
        **{
            "policy/data.pkl": b"\x80\x02N.",
            "policy/constants.pkl": b"\x80\x02).",
        }
    )
    with pytest.raises(MotionFileError, match="TorchScript"):
        import_motion(written(data), robot)


def test_the_word_that_protomotions_writes_beside_its_arrays(
    written, robot, short_clip, monkeypatch
):
    name = "protomotions.simulator.base_simulator.simulator_state"
    module = types.ModuleType(name)
    module.StateConversion = enum.Enum("StateConversion", {"COMMON": "common"}, module=name)
    for i in range(1, len(parts := name.split("."))):
        monkeypatch.setitem(sys.modules, ".".join(parts[:i]), types.ModuleType(parts[i - 1]))
    monkeypatch.setitem(sys.modules, name, module)
    motion = proto_motion(short_clip) | {"state_conversion": module.StateConversion.COMMON}
    clip = import_motion(written(to_torch(motion)), robot).clip
    np.testing.assert_allclose(clip.qpos, short_clip.qpos, atol=1e-6)


def test_one_motion_of_a_library(written, robot, short_clip):
    library = proto_library(short_clip, 3)
    library["gts"][41:82, :, 0] += 2.0
    path = written(to_torch(library))
    with pytest.raises(MotionFileError, match=r"3 motions.*--motion NUMBER, 0 to 2.*walk_0"):
        import_motion(path, robot)
    for chosen in ("1", "walk_1"):
        clip = import_motion(path, robot, options=Options(motion=chosen)).clip
        np.testing.assert_allclose(clip.qpos[:, 0], short_clip.qpos[:, 0] + 2, atol=1e-5)
    with pytest.raises(MotionFileError, match="no motion '3'; it has 0 to 2"):
        import_motion(path, robot, options=Options(motion="3"))


def test_other_layouts_in_an_archive_of_torch(written, robot, short_clip):
    """GMR's keys, as tensors and as numpy arrays."""
    motion = gmr_motion(short_clip)
    for convert in (torch.tensor, np.array):
        arrays = {k: convert(motion[k]) for k in ("root_pos", "root_rot", "dof_pos")}
        clip = import_motion(written(to_torch(arrays | {"fps": 50})), robot).clip
        np.testing.assert_allclose(clip.qpos, short_clip.qpos, atol=1e-9)
