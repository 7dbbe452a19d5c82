"""Which files a configuration means, and what changes their hashes."""

import hashlib

import pytest

from tlr_exp.config.input_files import file_hashes, model_hash, motion_content

SCENE = '<mujoco><include file="g1.xml"/></mujoco>'
ROBOT = '<mujoco><compiler meshdir="assets"/><asset><mesh name="a" file="a.stl"/></asset></mujoco>'


@pytest.fixture
def model(tmp_path):
    """A scene that includes a robot that has a mesh."""
    (tmp_path / "assets").mkdir()
    (tmp_path / "scene.xml").write_text(SCENE)
    (tmp_path / "g1.xml").write_text(ROBOT)
    (tmp_path / "assets" / "a.stl").write_text("a mesh")
    return tmp_path / "scene.xml"


def test_a_file_alone_has_the_hash_of_its_bytes(tmp_path):
    clip = tmp_path / "clip.npz"
    clip.write_bytes(b"abc")
    config = {"env": {"motion": str(clip), "robot": {"mjcf": None}}}
    assert file_hashes(config) == {"env.motion": hashlib.sha256(b"abc").hexdigest()}
    clip.write_text("<mujoco/>")
    config["env"]["robot"]["mjcf"] = str(clip)
    assert len(set(file_hashes(config).values())) == 1


def test_an_authored_motion_is_its_keyframes():
    content = motion_content("walk")
    assert content.startswith(b"# docs/keyframes.md")
    config = {"env": {"motion": "walk", "robot": {"mjcf": None}}}
    assert file_hashes(config) == {"env.motion": hashlib.sha256(content).hexdigest()}


@pytest.mark.parametrize("changed", ["scene.xml", "g1.xml", "assets/a.stl"])
def test_a_model_is_all_of_its_files(model, changed):
    before = model_hash(model)
    file = model.parent / changed
    file.write_text(file.read_text() + "<!-- another -->")
    assert model_hash(model) != before


def test_a_model_may_lie_anywhere(model, tmp_path):
    before = model_hash(model)
    moved = tmp_path / "moved"
    moved.mkdir()
    for path in [tmp_path / "assets", tmp_path / "g1.xml", model]:
        path.rename(moved / path.name)
    assert model_hash(moved / "scene.xml") == before


def test_what_is_no_xml_or_names_what_is_not_there_still_has_a_hash(tmp_path):
    (tmp_path / "a.xml").write_text("no xml")
    (tmp_path / "b.xml").write_text(SCENE)
    assert model_hash(tmp_path / "a.xml") != model_hash(tmp_path / "b.xml")
    with pytest.raises(FileNotFoundError):
        model_hash(tmp_path / "c.xml")
