"""Files made to do harm: nothing in them runs, and whatever the bytes are there is one error."""

import os
import pickle
import pickletools
import subprocess
import sys
from contextlib import suppress

import joblib
import numpy as np
import pytest
from foreign_files import WRITERS, asap_motion, locomujoco_arrays, npz, to_joblib
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from wild_files import WILD, WITHOUT_RATE

from tlr_exp.commands.motion import main
from tlr_exp.motion.importers.convert import import_motion
from tlr_exp.motion.importers.files.safe_pickle import load_pickle
from tlr_exp.motion.importers.raw import MotionFileError, Options

LIMIT = 1 << 20
HOSTILE = (
    "builtins.eval",
    "builtins.exec",
    "os.system",
    "subprocess",
    "joblib.load",
    "numpy.load",
    "getattr",
    "array of objects",
)


class Calls:
    """Pickles as a call of ``function`` with ``arguments``."""

    def __init__(self, function, *arguments):
        self.call = function, arguments

    def __reduce__(self):
        return self.call


def touch_by_eval(mark) -> Calls:
    return Calls(eval, f"open({str(mark)!r}, 'w').close()")


def hostile_objects(mark) -> dict[str, object]:
    """Each leaves ``mark`` behind when it is read by pickle itself."""
    code = f"open({str(mark)!r}, 'w').close()"
    inner = mark.with_suffix(".inner")
    inner.write_bytes(pickle.dumps(touch_by_eval(mark)))
    array = np.array([touch_by_eval(mark)], dtype=object)
    return {
        "builtins.eval": touch_by_eval(mark),
        "builtins.exec": Calls(exec, code),
        "os.system": Calls(os.system, f"touch {mark}"),
        "subprocess": Calls(subprocess.check_call, ["touch", str(mark)]),
        "joblib.load": Calls(joblib.load, str(inner)),
        "numpy.load": Calls(np.load, str(inner), None, True),
        "getattr": Calls(getattr, touch_by_eval(mark), "__class__"),
        "array of objects": array,
    }


@pytest.mark.parametrize("wrap", ["bare", "in a motion", "joblib"])
@pytest.mark.parametrize("name", HOSTILE)
def test_nothing_runs(name, wrap, written, tmp_path, robot, short_clip):
    mark = tmp_path / "it_ran"
    hostile = hostile_objects(mark)[name]
    motion = {"m": asap_motion(short_clip) | {"extra": hostile}}
    data = {
        "bare": lambda: pickle.dumps(hostile),
        "in a motion": lambda: pickle.dumps(motion),
        "joblib": lambda: to_joblib(motion),
    }[wrap]()
    path = written(data)
    with pytest.raises(MotionFileError, match="nothing in it was run"):
        import_motion(path, robot)
    assert not mark.exists()
    # The file is really hostile.
    joblib.load(path) if wrap == "joblib" else pickle.loads(data)
    assert mark.exists()


def test_objects_in_an_npz_are_not_read(written, tmp_path, robot, short_clip):
    mark = tmp_path / "it_ran"
    hostile = np.array([touch_by_eval(mark)], dtype=object)
    path = written(npz(**locomujoco_arrays(short_clip) | {"qpos": hostile}))
    with pytest.raises(MotionFileError, match=r"builtins.eval.*malicious"):
        import_motion(path, robot)
    assert not mark.exists()


@pytest.mark.parametrize(
    ("data", "shown"),
    [
        (b"cos\nsystem\n(S'true'\ntR.", "os.system"),
        (b"(S'true'\nios\nsystem\n.", "instruction INST"),
        (b"(cos\nsystem\nS'true'\no.", "os.system"),
        (b"\x80\x02Pabc\n.", "instruction PERSID"),
        (b"\x80\x02\x82\x01.", "instruction EXT1"),
        (b"\x80\x04cnumpy.core.multiarray\nos\n.", "numpy.core.multiarray.os"),
        (b"\x80\x04\x8c\x05numpy\x8c\x11ndarray.__class__\x93.", "numpy.ndarray.__class__"),
        (b"\x80\x04cnumpy.f2py.capi_maps\nload\n.", "numpy.f2py.capi_maps.load"),
        (b"\x80\x04cjoblib.numpy_pickle\nload\n.", "joblib.numpy_pickle.load"),
        (b"\x80\x04cos\x1b[31m\nsystem\n.", r"os\x1b[31m.system"),
    ],
)
def test_what_a_file_asks_for_is_named(data, shown):
    with pytest.raises(MotionFileError) as caught:
        load_pickle(data, LIMIT)
    assert shown in str(caught.value)


def test_permitted_names_do_not_become_numpy_objects():
    """Otherwise BUILD could change them, or REDUCE call what numpy did not mean to offer."""
    marker = load_pickle(b"\x80\x02cnumpy\nndarray\n.", LIMIT)
    assert not callable(marker)
    assert marker is not np.ndarray
    for program in (
        b"\x80\x02cnumpy\nndarray\n}b.",  # BUILD on the marker
        b"\x80\x02cnumpy\nndarray\n(K\x01tR.",  # ndarray(1)
    ):
        with pytest.raises(MotionFileError, match="nothing in it was run"):
            load_pickle(program, LIMIT)


@pytest.mark.parametrize(
    "program",
    [
        b"\x80\x04r\xff\xff\xff\x7f.",  # LONG_BINPUT into place 2^31
        b"\x80\x05\x96\x00\x00\x00\x00\x00\x01\x00\x00.",  # BYTEARRAY8 of 2^40 bytes
        b"\x80\x04\x8e\x00\x00\x00\x00\x00\x01\x00\x00.",  # BINBYTES8 likewise
        b"\x80\x04\x95\x00\x00\x00\x00\x00\x01\x00\x00.",  # FRAME likewise
    ],
)
def test_memory_is_not_set_aside_on_demand(program):
    """In a process of its own with 4 GB of memory to have."""
    script = (
        "import resource, sys; resource.setrlimit(resource.RLIMIT_AS, (4 << 30, 4 << 30))\n"
        "from tlr_exp.motion.importers.files.safe_pickle import load_pickle\n"
        "from tlr_exp.motion.importers.raw import MotionFileError\n"
        f"try: load_pickle({program!r}, 1 << 20)\n"
        "except MotionFileError as error: assert 'MemoryError' not in str(error), error\n"
        "else: sys.exit('it was read')\n"
    )
    subprocess.run([sys.executable, "-c", script], check=True, timeout=60)


def test_nesting_without_end_takes_no_time():
    """Each level holds the one before twice: 2^60 leaves in 400 bytes, as lists and as a key."""
    lists = []
    for _ in range(60):
        lists = [lists, lists]
    assert len(load_pickle(pickle.dumps({"dof": lists}), LIMIT)["dof"]) == 2
    # A dict, then () as memo 0; each level drops the last tuple and pairs it with itself.
    levels = b"".join(b"0h%ch%c\x86\x94" % (i, i) for i in range(60))
    with pytest.raises(MotionFileError, match="keys"):
        load_pickle(b"\x80\x04})\x94" + levels + b"K\x01s.", LIMIT)


def test_what_numpy_writes_is_read(short_clip):
    """Types, byte orders, memory orders and shared arrays, against pickle's own reading."""
    shared = np.arange(6.0).reshape(2, 3)
    content = {
        "fortran": np.asfortranarray(shared),
        "big": np.arange(3, dtype=">i4"),
        "bool": np.array([True, False]),
        "text": np.array(["a", "bcd"]),
        "empty": np.empty((0, 3)),
        "scalar": np.float32(1.5),
        "shared": shared,
        "again": shared,
    }
    for protocol in range(2, 6):
        ours = load_pickle(pickle.dumps(content, protocol=protocol), LIMIT)
        for key, value in content.items():
            np.testing.assert_array_equal(ours[key], value, strict=True)
    ours = load_pickle(to_joblib(content), LIMIT)
    for key, value in content.items():
        np.testing.assert_array_equal(ours[key], value, strict=True)


@st.composite
def mutations(draw, data: bytes) -> bytes:
    """The bytes with a few of them changed, cut out, doubled, or the end cut off."""
    changed = bytearray(data)
    # Half of the changes fall on the first bytes, where the structure is.
    place = st.integers(0, 400) | st.integers(0, len(data) - 1)
    for _ in range(draw(st.integers(1, 4))):
        at = min(draw(place), len(changed))
        kind = draw(st.sampled_from(["set", "cut", "double", "end"]))
        length = draw(st.integers(1, 8))
        if kind == "set":
            changed[at : at + length] = draw(st.binary(min_size=length, max_size=length))
        elif kind == "cut":
            del changed[at : at + length]
        elif kind == "double":
            changed[at:at] = changed[at : at + length]
        else:
            del changed[at:]
    return bytes(changed)


@pytest.mark.parametrize("name", [*WRITERS, *WILD])
def test_mutated_files_give_a_clip_or_the_one_error(name, motion_files, tmp_path, robot):
    path = tmp_path / "motion.bin"
    options = Options(fps=50.0) if name in WITHOUT_RATE else None

    @settings(
        max_examples=100,
        derandomize=True,
        suppress_health_check=[HealthCheck.function_scoped_fixture],
    )
    @given(st.data())
    def check(data):
        path.write_bytes(data.draw(mutations(motion_files[name])))
        message = ""
        try:
            import_motion(path, robot, options=options).clip.validate()
        except MotionFileError as error:
            message = str(error)
        assert message == "" or message.startswith(f"{path}: ")
        assert "\n" not in message

    check()


@given(st.binary(max_size=300) | st.binary(max_size=300).map(lambda b: b"\x80\x04" + b + b"."))
def test_any_bytes_as_a_pickle(data):
    if _is_plain(data):
        with suppress(MotionFileError):
            load_pickle(data, LIMIT)
    else:
        with pytest.raises(MotionFileError):
            load_pickle(data, LIMIT)


def _is_plain(data: bytes) -> bool:
    """Whether ``data`` is a pickle that names nothing: pickletools does not run what it lists."""
    try:
        names = {operation.name for operation, _, _ in pickletools.genops(data)}
    except Exception:
        return False
    return not names & {"GLOBAL", "STACK_GLOBAL", "INST", "OBJ", "PERSID", "BINPERSID"}


def test_a_hostile_file_leaves_no_output(written, tmp_path, capsys):
    mark, output = tmp_path / "it_ran", tmp_path / "out" / "clip.npz"
    output.parent.mkdir()
    path = written(pickle.dumps(touch_by_eval(mark)))
    assert main(["import", str(path), "-o", str(output)]) == 1
    assert not mark.exists()
    assert not list(output.parent.iterdir())
    captured = capsys.readouterr()
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert "builtins.eval" in captured.err
