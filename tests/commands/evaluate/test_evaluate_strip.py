"""tlr-evaluate --strip: which checkpoints it takes, what it calls the rows, what it refuses."""

import dataclasses
from pathlib import Path

import imageio.v3 as iio
import numpy as np
import pytest

from tlr_exp.assembly.learner import build_ppo
from tlr_exp.commands import evaluate
from tlr_exp.commands.evaluate import comparing
from tlr_exp.commands.evaluate.comparing import check_one_motion, iteration_at
from tlr_exp.pictures import graphics
from tlr_exp.records.checkpoint import CheckpointStore
from tlr_exp.records.run_directory import RunDirectory
from tlr_exp.training.loop import SNAPSHOT_SHARES

SMALL = ("ppo.hidden_sizes=[16]", "scale.num_envs=16", "scale.iterations=50")
ITERATIONS = (2, 10, 20, 44)  # 4, 20, 40, 88 % of 50


def make_run(path: Path, settings, method: str, iterations=ITERATIONS) -> Path:
    """A run directory whose policies were drawn and not trained."""
    RunDirectory.create(path, dataclasses.asdict(settings), tags={"method": method})
    store = CheckpointStore(path / "checkpoints", keep_last=9)
    ppo = build_ppo(settings)
    for iteration in iterations:
        store.save(iteration, {"trainer": {"ppo": ppo.state_dict()}}, -float(iteration))
    return path


@pytest.fixture(scope="module")
def runs(settings_of, tmp_path_factory) -> list[str]:
    folder = tmp_path_factory.mktemp("runs")
    return [str(make_run(folder / name, settings_of(*SMALL), name)) for name in ("fixed", "gwo")]


@pytest.fixture
def drawn(monkeypatch) -> list:
    """Titles and row labels of the strips, which are not drawn."""
    seen = []

    def draw(robot, rows, *, title, **_):
        seen.append((title, [row.label for row in rows]))
        return np.zeros((1, 1, 3), np.uint8)

    monkeypatch.setattr(comparing, "policy_strip", draw)
    monkeypatch.setattr(comparing, "graphics_backend", lambda: "none")
    return seen


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def test_the_papers_moments_are_those_that_training_keeps():
    assert tuple(share / 100 for share in comparing.PAPER_SHARES) == SNAPSHOT_SHARES
    assert [iteration_at(share, 2500) for share in comparing.PAPER_SHARES] == [100, 500, 1000, 2200]
    assert [iteration_at(share, 50) for share in comparing.PAPER_SHARES] == list(ITERATIONS)
    assert iteration_at(4.0, 5) == 1


def test_one_picture_for_each_of_the_papers_moments(runs, tmp_path, drawn):
    assert evaluate.main([*runs, "--strip", "-o", str(tmp_path / "gym.png")]) == 0
    assert names(tmp_path) == [f"gym-{share}percent.png" for share in ("04", 20, 40, 88)]
    assert [title for title, _ in drawn] == [f"short, iteration {n} of 50" for n in ITERATIONS]
    assert drawn[0][1] == ["static", "two-layered (GWO)"]


def test_iterations_as_they_are_asked_for(runs, tmp_path, drawn):
    command = [*runs, "--strip", "-o", str(tmp_path / "gym.png"), "--iterations"]
    assert evaluate.main([*command, "10,44"]) == 0
    assert names(tmp_path) == ["gym-000010.png", "gym-000044.png"]
    assert evaluate.main([*command, "2"]) == 0
    assert "gym.png" in names(tmp_path)  # a single one needs no number
    assert evaluate.main([*runs, "--strip", "-o", str(tmp_path / "b.png"), "--shares", "88"]) == 0
    assert [title for title, _ in drawn[2:]] == [f"short, iteration {n} of 50" for n in (2, 44)]


def test_best_checkpoints_and_files(runs, tmp_path, drawn, settings_of):
    early = make_run(tmp_path / "early", settings_of(*SMALL), "random", (7, 9))
    command = ["--strip", "-o", str(tmp_path / "a.png")]
    assert evaluate.main([runs[0], str(early), "--checkpoint", "best", *command]) == 0
    assert drawn == [("short", ["static\niteration 2", "random weights\niteration 7"])]
    files = [f"{run}/checkpoints/000020.pt" for run in runs]
    assert evaluate.main([*files, *command, "--force"]) == 0
    assert drawn[1] == ("short, iteration 20 of 50", ["static", "two-layered (GWO)"])


def test_rows_of_one_method_are_told_apart(runs, tmp_path, drawn, settings_of):
    other = make_run(tmp_path / "other", settings_of(*SMALL, "seed=3"), "gwo")
    twin = make_run(tmp_path / "twin", settings_of(*SMALL, "seed=3"), "gwo")
    command = ["--strip", "--iterations", "2", "-o", str(tmp_path / "a.png")]
    assert evaluate.main([*runs, str(other), *command]) == 0
    assert drawn[0][1] == ["static", "two-layered (GWO)\nseed 0", "two-layered (GWO)\nseed 3"]
    assert evaluate.main([str(other), str(twin), *command, "--force"]) == 0
    assert drawn[1][1] == [f"two-layered (GWO)\nseed 3\n{name}" for name in ("other", "twin")]


def test_a_strip_as_it_is_drawn(runs, tmp_path):
    try:
        graphics.graphics_backend()
    except graphics.GraphicsUnavailable as error:
        pytest.skip(str(error))
    small = ["--size", "48x60", "--quality", "fast", "--columns", "2", "--iterations", "2"]
    assert evaluate.main([*runs, "--strip", *small, "-o", str(tmp_path / "a.png")]) == 0
    picture = iio.imread(tmp_path / "a.png")
    assert picture.shape[0] > 3 * 60  # a row for the reference and one for each run
    assert picture.shape[1] > 2 * 48


# --- what it refuses -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--iterations", "2,100"], ["iteration 100", "2, 10, 20, 44", "best or last"]),
        (["--shares", "50"], ["iteration 25 (50 % of 50)", "2, 10, 20, 44"]),
        (["--checkpoint", "3"], ["no checkpoint '3'", "2, 10, 20, 44, last, best"]),
        (["--columns", "40"], ["columns is 40; the motion has 1 to 39 moments"]),
        (["-o", "strip.jpg"], ["strip.jpg should end in .png"]),
        (["-o", "no/folder/a.png"], ["there is no folder"]),
    ],
)
def test_mistakes_leave_nothing(runs, tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(comparing, "graphics_backend", lambda: "none")
    assert evaluate.main([*runs, "--strip", *arguments]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1
    for word in words:
        assert word in error
    assert names(tmp_path) == []


def test_a_strip_of_others_is_not_replaced_unasked(runs, tmp_path, monkeypatch, drawn, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "strip-20percent.png").write_text("mine")
    command = [*runs, "--strip", "--shares"]
    assert evaluate.main([*command, "4,20"]) == 2
    assert capsys.readouterr().err.endswith("strip-20percent.png exists; --force replaces it\n")
    assert drawn == []  # not the first one either
    assert names(tmp_path) == ["strip-20percent.png"]
    assert (tmp_path / "strip-20percent.png").read_text() == "mine"
    assert evaluate.main([*command, "4,20", "--force"]) == 0
    assert len(drawn) == 2
    assert evaluate.main([*command, "20"]) == 0  # strip.png: another file


@pytest.mark.parametrize("text", ["", "4,,20", "-4", "0", "many"])
def test_what_is_no_list_of_numbers(runs, text, capsys):
    with pytest.raises(SystemExit) as exit_:
        evaluate.main([*runs, "--strip", f"--shares={text}"])
    assert exit_.value.code == 2
    assert "is no list of positive numbers like 4,20" in capsys.readouterr().err


def test_runs_of_different_motions_are_named(runs, short_clip, settings_of, tmp_path):
    fields = {
        field.name: getattr(short_clip, field.name)[:-1]
        for field in dataclasses.fields(short_clip)
        if isinstance(getattr(short_clip, field.name), np.ndarray)
        and len(getattr(short_clip, field.name)) == short_clip.num_frames
    }
    other = dataclasses.replace(short_clip, **fields)
    other.save(tmp_path / "shorter.npz")
    settings = settings_of(*SMALL, f"env.motion={tmp_path / 'shorter.npz'}")
    run = make_run(tmp_path / "another", settings, "gwo")
    choices = [evaluate.choose(Path(path)) for path in (runs[0], run)]
    with pytest.raises(ValueError, match=r"one motion: fixed tracks .*short\.npz.*another tracks"):
        check_one_motion(choices)
    short_clip.save(tmp_path / "shorter.npz")  # another file of the same motion will do
    check_one_motion(choices)


def test_runs_of_different_robots_are_named(runs):
    first, second = (evaluate.choose(Path(run)) for run in runs)
    robot = dataclasses.replace(second.settings.env.robot, mjcf="mine.xml")
    env = dataclasses.replace(second.settings.env, robot=robot)
    other = dataclasses.replace(second, settings=dataclasses.replace(second.settings, env=env))
    with pytest.raises(ValueError, match=r"fixed has the G1, gwo has mine\.xml"):
        check_one_motion([first, other])
