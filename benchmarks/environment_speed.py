"""Control steps a second of the whole environment, by engine and number of environments.

    python benchmarks/environment_speed.py --device cuda --output results.json

One process measures one combination, so that no engine keeps memory from the next.
"""

import argparse
import json
import platform
import subprocess
import sys
import time
from importlib import metadata
from pathlib import Path

COMBINATIONS = [
    (physics, num_envs)
    for physics in (["mjx", "physics.impl=jax"], ["mjx", "physics.impl=warp"], ["native"])
    for num_envs in (1024, 4096, 8192)
]
PACKAGES = ("torch", "jax", "mujoco", "mujoco-mjx", "warp-lang", "tlr_exp")
NUM_STEPS = 24


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--device", default="cpu", help="cpu or cuda")
    parser.add_argument("--output", type=Path, help="write the measurements to this JSON file")
    parser.add_argument("--one", nargs=2, metavar=("OVERRIDES", "NUM_ENVS"), help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.one:
        print(
            json.dumps(measure(arguments.one[0].split(), int(arguments.one[1]), arguments.device))
        )
        return
    rows = [measure_apart(*combination, arguments.device) for combination in COMBINATIONS]
    record = {
        "device": device_name(arguments.device),
        "machine": platform.platform(),
        "versions": versions(),
        "command": " ".join(["python", *sys.argv]),
        "num_steps": NUM_STEPS,
        "rows": rows,
    }
    if arguments.output:
        arguments.output.write_text(json.dumps(record, indent=2) + "\n")


def measure_apart(physics: list[str], num_envs: int, device: str) -> dict:
    """Measure one combination in a process of its own; a failure becomes a row, not an end."""
    command = [sys.executable, __file__, "--device", device, "--one"]
    overrides = " ".join([f"physics={physics[0]}", *physics[1:]])
    done = subprocess.run(
        [*command, overrides, str(num_envs)], capture_output=True, text=True, check=False
    )
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

    from tlr_exp.assembly import build_clip, build_env, build_robot_of
    from tlr_exp.config import load_settings

    overrides = [*overrides, f"scale.num_envs={num_envs}", f"device={device}"]
    with initialize_config_module("tlr_exp.conf", version_base="1.3"):
        settings = load_settings(compose("config", overrides))
    start = time.perf_counter()
    robot = build_robot_of(settings.env)
    env = build_env(settings, robot, build_clip(settings.env, robot))
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
    main()
