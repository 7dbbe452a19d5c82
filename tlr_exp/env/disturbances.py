"""What happens to robots from outside, and how they differ from their model, in each episode.

The engine lets robots differ and pushes them; targets are delayed here.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import torch
from torch import Tensor

from tlr_exp.config.settings import Disturbances
from tlr_exp.errors import UserError
from tlr_exp.physics.protocol import Physics
from tlr_exp.robot.model import Robot

# What is drawn at the start of an episode and told to the engine.
_OF_THE_MODEL = ("friction", "mass", "com_m", "kp", "kd", "armature")


def check_engine(settings: Disturbances, engine: Any) -> None:
    """Refuse disturbances that an engine, or its class, cannot do.

    Raises:
        UserError: names the keys and an engine that can.
    """
    can = getattr(engine, "disturbances", ())
    lacking = [
        f"env.disturbance.{name}"
        for name in ("push_m_s", *_OF_THE_MODEL)
        if getattr(settings, name) is not None and name not in can
    ]
    if lacking:
        name = getattr(engine, "__name__", type(engine).__name__)
        raise UserError(f"{name} cannot do {', '.join(lacking)}; physics=native can")


class Disturber:
    """Draws and applies the disturbances of all robots.

    Args:
        settings: the ranges to draw from (the group ``env.disturbance``).
        robot: for the numbers of its joints and bodies.
        physics: the engine of the robots.
        seed: of the generator that all of them are drawn from.

    Attributes:
        now: what each robot has or waits for, by name; first axis num_envs. Of the model the values
            as ``Physics.vary`` takes them; ``delay`` in control steps; ``queue`` [num_envs, longest
            delay + 1, 23], the targets on their way, newest first; ``wait``, steps until a push.

    Raises:
        UserError: the engine cannot do one of them.
    """

    def __init__(self, settings: Disturbances, robot: Robot, physics: Physics, seed: int) -> None:
        check_engine(settings, physics)
        self.settings = settings
        self.physics = physics
        self.generator = torch.Generator(device=physics.device).manual_seed(seed)
        joints = robot.spec.num_joints
        widths: dict[str, tuple[int, ...]] = {
            **{"friction": (), "mass": (robot.model.nbody,), "com_m": (3,)},
            **dict.fromkeys(("kp", "kd", "armature"), (joints,)),
        }
        self._of_the_model = [n for n in _OF_THE_MODEL if getattr(settings, n) is not None]
        shapes = {name: widths[name] for name in self._of_the_model}
        if settings.delay_steps is not None:
            shapes |= {"delay": (), "queue": (settings.delay_steps[1] + 1, joints)}
        if settings.push_m_s is not None:
            shapes["wait"] = ()
        whole = ("delay", "wait")
        self.now = {
            name: torch.zeros(
                (physics.num_envs, *shape),
                dtype=torch.int64 if name in whole else torch.float32,
                device=physics.device,
            )
            for name, shape in shapes.items()
        }

    def begin(self, env_ids: Tensor, joint_pos: Tensor) -> None:
        """Draw anew for the robots that start an episode, before the engine is set to their state.

        Args:
            env_ids: [n] int64.
            joint_pos: where their joints start, rad, [n, 23]: their target until one arrives.
        """
        if not self.now:
            return
        count = len(env_ids)
        drawn = {name: self._drawn(name, count) for name in self._of_the_model}
        if drawn:
            self.physics.vary(env_ids, drawn)
        if self.settings.delay_steps is not None:
            low, high = self.settings.delay_steps
            drawn["delay"] = torch.randint(low, high + 1, (count,), **self._source)
            drawn["queue"] = joint_pos[:, None].expand(-1, high + 1, -1)
        if "wait" in self.now:
            drawn["wait"] = self._drawn_wait(count)
        # Tensors that were handed out stay as they are: write into copies.
        self.now = {
            name: value.index_copy(0, env_ids, drawn[name]) for name, value in self.now.items()
        }

    def deliver(self, joint_target: Tensor) -> Tensor:
        """The targets that reach the motors in the step that begins, [num_envs, 23], rad.

        Robots whose time has come are pushed.
        """
        if "wait" in self.now:
            self._push()
        if "delay" not in self.now:
            return joint_target
        queue = torch.cat((joint_target[:, None], self.now["queue"][:, :-1]), dim=1)
        self.now = {**self.now, "queue": queue}
        return queue[torch.arange(len(queue), device=queue.device), self.now["delay"]]

    def _push(self) -> None:
        wait = self.now["wait"]
        due = (wait == 0).nonzero().flatten()
        if len(due):
            size = self._uniform(self.settings.push_m_s, len(due))
            angle = self._uniform((0.0, 2.0 * math.pi), len(due))
            velocity = (size * angle.cos(), size * angle.sin(), torch.zeros_like(size))
            self.physics.push(due, torch.stack(velocity, dim=-1))
            wait = wait.index_copy(0, due, self._drawn_wait(len(due)))
        self.now = {**self.now, "wait": wait - 1}

    def _drawn_wait(self, count: int) -> Tensor:
        """Control steps to the next push, at least 1, [count]."""
        seconds = self._uniform(self.settings.push_every_s, count)
        return (seconds / self.physics.control_dt).round().clamp(min=1.0).long()

    def _drawn(self, name: str, count: int) -> Tensor:
        """Values of something of the model for ``count`` robots."""
        size = (count, *self.now[name].shape[1:])
        bounds = getattr(self.settings, name)
        if name != "com_m":
            return self._uniform(bounds, *size)
        direction = torch.randn(size, **self._source)
        direction = direction / direction.norm(dim=-1, keepdim=True)
        return direction * self._uniform(bounds, count, 1)

    def _uniform(self, bounds: Sequence[float] | None, *size: int) -> Tensor:
        low, high = bounds or (0.0, 0.0)
        return low + (high - low) * torch.rand(size, **self._source)

    @property
    def _source(self) -> dict[str, Any]:
        return {"generator": self.generator, "device": self.generator.device}

    def state_dict(self) -> dict[str, Tensor]:
        """The generator and ``now``; nothing writes into these tensors."""
        return {"generator": self.generator.get_state(), **self.now}

    def load_state_dict(self, state: Mapping[str, Tensor]) -> None:
        """Continue from ``state_dict``, before the engine does from its own."""
        self.generator.set_state(state["generator"])
        self.now = {name: state[name].to(value) for name, value in self.now.items()}
        if self._of_the_model:
            everyone = torch.arange(self.physics.num_envs, device=self.physics.device)
            values = {name: self.now[name] for name in self._of_the_model}
            self.physics.vary(everyone, values)
