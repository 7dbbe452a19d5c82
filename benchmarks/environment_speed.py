"""Control steps a second of the whole environment, by engine and number of environments.

    python benchmarks/environment_speed.py --device cuda --output results.json

One process measures one combination, so that no engine keeps memory from the next. The file is
written anew after each of them; a second call goes on with those that it lacks.
"""

import argparse
import json
import os
import platform
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

ENGINES = ("mjx physics.impl=jax", "native", "mjx physics.impl=warp")
NUM_ENVS = (1024, 4096, 8192)
PACKAGES = ("torch", "jax", "mujoco", "mujoco-mjx", "warp-lang", "tlr_exp")
NUM_STEPS = 24


def main(words: list[str] | None = None) -> int:
    """The command line; returns the exit status: 0, or 2 for a record that is of something else."""
    options = _parser().parse_args(words)
    if options.one:
        print(json.dumps(measure(options.one[0].split(), int(options.one[1]), options.device)))
        return 0
    record = {
        "device": device_name(options.device),
        "machine": platform.platform(),
        "versions": versions(),
        "num_steps": NUM_STEPS,
    }
    try:
        rows = [] if options.again else measured_before(options.output, record)
    except ValueError as error:
        print(f"environment_speed.py: {error}", file=sys.stderr)
        return 2
    # All engines at one size first: a time that is too short ends with a comparison.
    wanted = [(f"physics={e}", n) for n in options.num_envs for e in options.physics or ENGINES]
    record["command"] = " ".join(["python", *sys.argv])
    measure_all(wanted, rows, record, options)
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--output", type=Path, help="the JSON file to write, or to go on with")
    parser.add_argument("--num-envs", type=int, nargs="+", default=NUM_ENVS, metavar="N")
    parser.add_argument(
        "--physics",
        action="append",
        metavar="OVERRIDES",
        help=f"an engine, several times for several (default: {'; '.join(ENGINES)})",
    )
    parser.add_argument("--seconds", type=float, help="stop in time; a row that is begun is lost")
    parser.add_argument("--again", action="store_true", help="measure anew what the file holds")
    parser.add_argument("--one", nargs=2, metavar=("OVERRIDES", "NUM_ENVS"), help=argparse.SUPPRESS)
    return parser


def measured_before(path: Path | None, record: dict) -> list[dict]:
    """The rows that the file at ``path`` holds of the device and versions of ``record``.

    Those that failed are left out: they are tried again.

    Raises:
        ValueError: the file is damaged, or of another device or other versions.
    """
    if path is None or not path.exists():
        return []
    try:
        before = json.loads(path.read_text())
        rows = [row for row in before["rows"] if "error" not in row]
    except (ValueError, TypeError, KeyError) as error:
        raise ValueError(f"{path} is no record of speeds ({error}); --again replaces it") from error
    for name in ("device", "versions", "num_steps"):
        if before.get(name) != record[name]:
            raise ValueError(
                f"{path} was measured with {name} {before.get(name)}, and here it is "
                f"{record[name]}; --again replaces it, another --output keeps both"
            )
    return rows


def measure_all(
    wanted: list[tuple[str, int]], rows: list[dict], record: dict, options: argparse.Namespace
) -> None:
    """Add what ``rows`` lacks, one by one, and write the file after each; stop in time."""
    end = None if options.seconds is None else time.monotonic() + options.seconds
    done = {(row["physics"], row["num_envs"]) for row in rows}
    for overrides, num_envs in wanted:
        if (overrides, num_envs) in done:
            print(f"{overrides:40} {num_envs:6} is measured already", flush=True)
            continue
        try:
            left = None if end is None else max(end - time.monotonic(), 0.0)
            rows.append(measure_apart(overrides, num_envs, options.device, left))
        except subprocess.TimeoutExpired:
            print(f"{overrides:40} {num_envs:6} out of time; another call goes on here", flush=True)
            return
        if options.output:
            write(options.output, {**record, "rows": rows})


def write(path: Path, record: dict) -> None:
    """Replace the file at once: a reader, or a kill, finds the old one or the new one."""
    temporary = path.with_name(f".{path.name}.tmp")
    temporary.write_text(json.dumps(record, indent=2) + "\n")
    os.replace(temporary, path)


def measure_apart(overrides: str, num_envs: int, device: str, seconds: float | None) -> dict:
    """Measure one combination in a process of its own; a failure becomes a row, not an end.

    Raises:
        subprocess.TimeoutExpired: it took longer than ``seconds``, if given; the process is ended.
    """
    command = [sys.executable, __file__, "--device", device, "--one", overrides, str(num_envs)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=seconds)
    row = {"physics": overrides, "num_envs": num_envs}
    if done.returncode == 0:
        row |= json.loads(done.stdout.splitlines()[-1])
        print(f"{overrides:40} {num_envs:6} {row['steps_per_s']:12,.0f} steps/s", flush=True)
    else:
        row["error"] = (done.stderr.strip().splitlines() or ["no output"])[-1]
        print(f"{overrides:40} {num_envs:6} failed: {row['error']}", flush=True)
    return row


def measure(overrides: list[str], num_envs: int, device: str) -> dict:
    """Steps a second of one environment, policy excluded; compilation is timed apart."""
    import torch
    from hydra import compose, initialize_config_module

    from tlr_exp.assembly.environment import build_env
    from tlr_exp.assembly.terms import terms_of_training
    from tlr_exp.assembly.world import build_clip, build_robot_of
    from tlr_exp.config.load import load_settings

    overrides = [*overrides, f"scale.num_envs={num_envs}", f"device={device}"]
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        settings = load_settings(compose("config", overrides))
    start = time.perf_counter()
    robot = build_robot_of(settings.env)
    clip = build_clip(settings.env, robot)
    env = build_env(settings, robot, clip, terms_of_training(settings))
    now = env.reset()
    action = torch.zeros(num_envs, env.action_spec.shape[-1], device=device)
    for _ in range(3):
        _, now = env.step_and_maybe_reset(now.set("action", action))
    ready_s = time.perf_counter() - start
    start = time.perf_counter()
    for _ in range(NUM_STEPS):
        _, now = env.step_and_maybe_reset(now.set("action", action))
    if device != "cpu":
        torch.cuda.synchronize()
    elapsed_s = time.perf_counter() - start
    return {"steps_per_s": num_envs * NUM_STEPS / elapsed_s, "ready_s": ready_s}


def device_name(device: str) -> str:
    if device == "cpu":
        return platform.processor() or platform.machine()
    import torch

    return torch.cuda.get_device_name()


def versions() -> dict[str, str]:
    found = {}
    for package in PACKAGES:
        try:
            found[package] = metadata.version(package)
        except metadata.PackageNotFoundError:
            continue
    return found


if __name__ == "__main__":
    sys.exit(main())
