"""Models of one's own: what may stand in for Menagerie's robot, and what is refused."""

from collections.abc import Callable
from pathlib import Path
from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest

from tlr_exp.robot.model import COLLISION_SETS, Robot, build_robot, load_source, model_scene


@pytest.fixture(scope="module")
def write_variant(tmp_path_factory: pytest.TempPathFactory) -> Callable[..., Path]:
    """``write_variant(edit)``: Menagerie's robot without meshes, edited, as a file of one's own."""

    def write(edit: Callable[[mujoco.MjSpec], None] = lambda spec: None) -> Path:
        spec = mujoco.MjSpec.from_file(str(model_scene()))
        for geom in spec.geoms:
            if geom.type == mujoco.mjtGeom.mjGEOM_MESH:
                spec.delete(geom)
        for mesh in spec.meshes:
            spec.delete(mesh)
        for key in spec.keys:
            spec.delete(key)
        edit(spec)
        spec.compile()
        path = tmp_path_factory.mktemp("mjcf") / "own.xml"
        path.write_text(spec.to_xml())
        return path

    return write


def test_model_of_one_s_own_is_taken(write_variant: Callable[..., Path], robot: Robot) -> None:
    def heavier(spec: mujoco.MjSpec) -> None:
        spec.body("torso_link").mass += 1.0

    own = build_robot(write_variant(heavier))
    assert own.model.body_mass.sum() == pytest.approx(robot.model.body_mass.sum() + 1.0)
    np.testing.assert_array_equal(own.model.actuator_gainprm, robot.model.actuator_gainprm)


def test_model_of_one_s_own_with_contact_bits_and_no_floor(
    write_variant: Callable[..., Path],
) -> None:
    """Where a model has no explicit pairs, the feet are told from the rest by their bits."""

    def bits_in_place_of_pairs(spec: mujoco.MjSpec) -> None:
        for pair in spec.pairs:
            spec.delete(pair)
        spec.delete(spec.geom("floor"))
        for geom in spec.geoms:
            geom.contype = geom.conaffinity = 1

    path = write_variant(bits_in_place_of_pairs)
    for collisions in COLLISION_SETS:
        robot = build_robot(path, collisions=collisions)
        data = mujoco.MjData(robot.model)
        data.qpos[2] = 0.745
        data.qpos[7:] = robot.default_joint_pos_rad
        mujoco.mj_forward(robot.model, data)
        touching = [robot.model.geom_bodyid[[c.geom1, c.geom2]] for c in data.contact]
        with_floor = [pair for pair in touching if 0 in pair]
        assert with_floor, "the feet stand on the floor that was added"
        if collisions == "feet":
            assert len(with_floor) == len(touching)
            assert {max(pair) for pair in with_floor} == set(robot.foot_body_ids)


def test_another_robot_is_refused_with_what_it_has(tmp_path: Path) -> None:
    path = tmp_path / "hopper.xml"
    path.write_text(
        "<mujoco><worldbody><body name='pelvis'><freejoint/><geom size='.1'/>"
        "<body name='leg'><joint name='knee'/><geom size='.1'/></body></body></worldbody></mujoco>"
    )
    with pytest.raises(ValueError, match="not a 23-joint G1") as error:
        build_robot(path)
    message = str(error.value)
    assert "env.robot.mjcf" in message
    assert "lacks the joints left_hip_pitch_joint" in message
    assert message.endswith("it has knee")


def test_a_missing_link_is_named(write_variant: Callable[..., Path]) -> None:
    def rename(spec: mujoco.MjSpec) -> None:
        spec.body("torso_link").name = "chest"

    with pytest.raises(ValueError, match=r"lacks the bodies torso_link; it has .*chest"):
        build_robot(write_variant(rename))


def test_a_robot_bolted_to_the_world_is_refused(write_variant: Callable[..., Path]) -> None:
    def bolt(spec: mujoco.MjSpec) -> None:
        for joint in spec.body("pelvis").joints:
            spec.delete(joint)

    with pytest.raises(ValueError, match=r"the pelvis .* has no free joint"):
        build_robot(write_variant(bolt))


def test_joints_in_another_order_are_refused(write_variant: Callable[..., Path]) -> None:
    """Joint angles are told apart by their place alone, so another order would go unnoticed."""
    path = write_variant()
    root = ElementTree.parse(path).getroot()
    pelvis = next(body for body in root.iter("body") if body.get("name") == "pelvis")
    limbs = pelvis.findall("body")
    for limb in limbs:
        pelvis.remove(limb)
    pelvis.extend(reversed(limbs))
    path.write_text(ElementTree.tostring(root, encoding="unicode"))
    message = r"order left_hip_pitch_joint, .*; the model has waist_yaw_joint, .* \(nq = 30\)"
    with pytest.raises(ValueError, match=message):
        build_robot(path)


def test_mesh_that_gives_a_link_its_inertia_is_kept(tmp_path: Path) -> None:
    spec = load_source()
    spec.meshdir = str(model_scene().parent / "assets")
    spec.body("torso_link").explicitinertial = False
    path = tmp_path / "own.xml"
    expected = spec.compile().body("torso_link").mass
    path.write_text(spec.to_xml())
    found = build_robot(path).model.body("torso_link").mass
    np.testing.assert_allclose(found, expected)


def test_model_that_does_not_compile_is_named(tmp_path: Path) -> None:
    path = tmp_path / "own.xml"
    path.write_text(load_source().to_xml())  # without the folder of its meshes
    with pytest.raises(ValueError, match=r"env\.robot\.mjcf: MuJoCo cannot compile .*own\.xml"):
        build_robot(path, visuals=True)


def test_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError, match=r"env\.robot\.mjcf: there is no file .*none\.xml"):
        build_robot(tmp_path / "none.xml")
    with pytest.raises(FileNotFoundError, match="there is no file"):
        build_robot(tmp_path)


@pytest.mark.parametrize("text", ["", "<mujoco", "<urdf/>", "<mujoco><worldbody><bod/>"])
def test_file_that_is_no_mjcf_is_refused(tmp_path: Path, text: str) -> None:
    path = tmp_path / "broken.xml"
    path.write_text(text)
    with pytest.raises(ValueError, match=r"env\.robot\.mjcf: MuJoCo cannot read .*broken\.xml"):
        build_robot(path)


def test_a_second_free_body_is_refused_because_qpos_would_not_be_the_robot_alone(
    write_variant: Callable[..., Path],
) -> None:
    def with_ball(spec: mujoco.MjSpec) -> None:
        ball = spec.worldbody.add_body(name="ball", pos=(2.0, 0.0, 0.1))
        ball.add_freejoint()
        ball.add_geom(type=mujoco.mjtGeom.mjGEOM_SPHERE, size=(0.1, 0.0, 0.0))

    with pytest.raises(ValueError, match=r"in the order left_hip_pitch_joint.*nq = 37"):
        build_robot(write_variant(with_ball))
