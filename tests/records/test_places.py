"""What is published names neither people nor machines."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tlr_exp.records.places import plain_command, plain_text, plain_values


@pytest.mark.parametrize(
    ("text", "plain"),
    [
        ("env.motion=/home/ann/clips/walk.yaml", "env.motion=walk.yaml"),
        ("/home/ann/my clips/a walk.yaml", "a walk.yaml"),
        ("runs_dir=/home/ann", "runs_dir=HOME"),
        ("/home/ann/", "HOME"),
        ("/Users/ann", "HOME"),
        ("~", "HOME"),
        ("~ann/runs", "runs"),
        ("../ann/runs", "runs"),
        ("[/home/ann/b.yaml,/srv/d.npz]", "[b.yaml,d.npz]"),
        ("/opt/ann:/home/ann/lib", "ann:lib"),
        (r"C:\Users\ann\clip.npz", "clip.npz"),
        (r"C:\Users\ann", "HOME"),
        ("hydra.searchpath=[file:///home/ann/conf]", "hydra.searchpath=[file://conf]"),
        ("sqlite:////home/ann/mlflow.db", "sqlite:///mlflow.db"),
        ("tracking_uri=http://ann:pw@srv.lab:5000/x", "tracking_uri=http://HOST"),
        ("postgresql+psycopg2://ann:pw@srv/db", "postgresql+psycopg2://HOST"),
    ],
)
def test_places_keep_their_last_part(text: str, plain: str) -> None:
    assert plain_text(text) == plain


@pytest.mark.parametrize(
    "text",
    [
        "",
        "optimizer=fixed,gwo",
        "tlr_exp.physics.native.NativePhysics",
        "two percent of the paper's experience and/or more",
        "runs/five-seeds/laptop-gwo-seed0",
        "pkg://tlr_exp.conf",
        "ratio 1/2, 3:4, -1.5e-07",
        "train.py",
        "gym_motion",
    ],
)
def test_all_else_stays(text: str) -> None:
    assert plain_text(text) == text


NAMES = st.text("abcdefgh0123456789_-", min_size=1, max_size=8)


@given(folders=st.lists(NAMES, min_size=1, max_size=4), name=NAMES, key=NAMES, user=NAMES)
def test_no_folder_of_a_home_shows(folders: list[str], name: str, key: str, user: str) -> None:
    path = "/".join(["/home", f"USER{user}", *folders, f"{name}.yaml"])
    assert plain_text(path) == f"{name}.yaml"
    assert plain_command(f"tlr-train {key}={path} seed=1") == f"tlr-train {key}={name}.yaml seed=1"
    assert plain_values({key: [{"a": path}, 1, None]}) == {key: [{"a": f"{name}.yaml"}, 1, None]}


@given(st.text(max_size=60))
def test_any_text_is_taken(text: str) -> None:
    plain_command(text)
    for line in text.splitlines():
        once = plain_text(f"/home/ann/{line}")
        assert "/home/ann" not in once


def test_commands_are_quoted_anew() -> None:
    command = "train.py 'env.motion=/home/an n/my walk.yaml' 'a=[1, 2]'"
    assert plain_command(command) == "train.py 'env.motion=my walk.yaml' 'a=[1, 2]'"
    assert plain_command("it's /home/ann/x") == "'it'\"'\"'s' x"  # no shell wrote that
