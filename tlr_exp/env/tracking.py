"""The motion-tracking environment: physics, a reference motion and the MDP's functions.

It reports raw reward terms and no reward: how terms are weighted is decided after collection
(``tlr_exp.reward.split``).
"""

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from tlr_exp import keys
from tlr_exp.config.limits import ACTIONS, OBSERVATIONS, START_PHASES, check_choice
from tlr_exp.config.settings import EnvSettings
from tlr_exp.env import observations, specs
from tlr_exp.env.errors import tracking_errors
from tlr_exp.env.instability import UnstableStates
from tlr_exp.env.instant import Instant
from tlr_exp.env.resets import perturb
from tlr_exp.env.starts import StartFrames
from tlr_exp.env.terminations import TighteningDistance, far_from_reference, fell
from tlr_exp.env.terms import TERMS, JointLimits, Transition
from tlr_exp.motion.reference import Reference, ReferenceFrame
from tlr_exp.physics.protocol import Physics
from tlr_exp.physics.state import PhysicsState
from tlr_exp.robot.model import Robot


class TrackingEnv(EnvBase):
    """``num_envs`` robots that track one motion at ``1 / physics.control_dt`` Hz.

    An episode starts in the state of the reference at some frame and ends by a failure
    (``terminated``), or with the motion (``truncated``). ``("next", "reward_terms")``
    [num_envs, num_terms] holds the raw terms in the order of ``terms``.

    Args:
        physics: the engine; its number of environments and device are the environment's.
        reference: the motion, at the control rate and on the same device.
        robot: tables of the joints (default pose, limits, action scale).
        terms: names of the reward terms and the constants that each takes.
        settings: observation, action, starts and ends of episodes.
        seed: of the environment's own generator.
        failures: whether an episode can end by a failure (evaluations let it go on).

    Raises:
        ValueError: a choice that does not exist, or a motion that does not fit.
    """

    def __init__(
        self,
        physics: Physics,
        reference: Reference,
        robot: Robot,
        terms: Mapping[str, Mapping[str, float]],
        settings: EnvSettings,
        seed: int,
        failures: bool = True,
    ) -> None:
        super().__init__(device=physics.device, batch_size=torch.Size([physics.num_envs]))
        check_choice("env.observation", settings.observation, OBSERVATIONS)
        check_choice("env.action", settings.action, ACTIONS)
        check_choice("env.start_phase", settings.start_phase, START_PHASES)
        _check_motion(reference, physics.control_dt, settings.reference_lead)
        self.physics = physics
        self.spec = robot.spec
        self.reference = reference
        self.settings = settings
        self.failures = failures
        self.term_names = tuple(terms)
        self.terms = [partial(TERMS[name], **constants) for name, constants in terms.items()]

        tensor = partial(torch.as_tensor, dtype=torch.float32, device=self.device)
        self.default_joint_pos = tensor(robot.default_joint_pos_rad)
        self.action_scale = tensor(robot.action_scale_rad)
        self.damping_time_s = tensor(robot.kd / robot.kp)
        self.limits = JointLimits(
            tensor(robot.joint_range_rad),
            tensor(robot.velocity_limit_rad_s),
            tensor(robot.effort_limit_nm),
        )
        self.distance = TighteningDistance(settings.termination, physics.num_envs, self.device)
        # The reference is read ahead, and an episode has one step at least.
        num_starts = reference.num_frames - 1 - settings.reference_lead
        self.starts = StartFrames(settings.start_phase, num_starts, reference.fps, self.device)
        self._frames: Tensor | None = None
        self.generator = torch.Generator(device=self.device).manual_seed(seed)
        self._make_specs(len(terms))
        self._make_buffers()

    # --- specs and buffers -------------------------------------------------------------------

    def _make_specs(self, num_terms: int) -> None:
        dim = observations.observation_dims(self.spec)[self.settings.observation]
        privileged_dim = observations.privileged_dim(self.spec)
        self.observation_spec = specs.observation_spec(
            self.batch_size, self.device, dim, privileged_dim
        )
        self.action_spec = specs.action_spec(self.batch_size, self.device, self.spec.num_joints)
        self.reward_spec = specs.reward_terms_spec(self.batch_size, self.device, num_terms)
        self.done_spec = specs.done_spec(self.batch_size, self.device)

    def _make_buffers(self) -> None:
        n, device = self.batch_size[0], self.device
        self.start_frame = torch.zeros(n, dtype=torch.int64, device=device)
        self.episode_step = torch.zeros(n, dtype=torch.int64, device=device)
        self.previous_action = torch.zeros(n, self.spec.num_joints, device=device)
        dim = observations.observation_dims(self.spec)[self.settings.observation]
        self.observed = torch.zeros(n, dim, device=device)
        self.privileged = torch.zeros(n, observations.privileged_dim(self.spec), device=device)
        self.state: PhysicsState = self.physics.state()
        self._unstable = UnstableStates()
        self._resume_pending = False

    # --- stepping ----------------------------------------------------------------------------

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get(keys.ACTION)
        before = self.state
        self._resume_pending = False
        after = self.physics.step(self._joint_target(action))
        self.state, unstable = self._unstable.replace(after, before, action)
        self.episode_step = self.episode_step + 1
        frame_index = self._frame_index()
        instant = Instant(self.state, self.reference.frame(frame_index), self.spec)
        fallen = fell(instant, self.settings.termination.max_tilt)
        terminated = unstable
        if self.failures:
            far = far_from_reference(instant, self.distance.value_m)
            terminated = terminated | fallen | far
        truncated = (frame_index >= self.reference.num_frames - 1) & ~terminated
        done = terminated | truncated
        self.distance.update(self.episode_step, done)
        self.starts.update(self.start_frame + self.episode_step, terminated)

        transition = Transition(instant, action, self.previous_action, terminated, self.limits)
        terms = torch.stack([term(transition) for term in self.terms], dim=-1)
        self._observe(instant, action, frame_index)
        self.previous_action = action
        return TensorDict(
            {
                keys.OBSERVATION: self.observed,
                keys.PRIVILEGED: self.privileged,
                keys.REWARD_TERMS: terms,
                **tracking_errors(instant),
                keys.FELL: fallen[:, None],
                keys.UNSTABLE: unstable[:, None],
                keys.TERMINATED: terminated[:, None],
                keys.TRUNCATED: truncated[:, None],
                keys.DONE: done[:, None],
            },
            batch_size=self.batch_size,
            device=self.device,
        )

    def step_and_maybe_reset(
        self, tensordict: TensorDictBase
    ) -> tuple[TensorDictBase, TensorDictBase]:
        """What ``EnvBase`` does, to the bit, without its general merge of partial resets.

        That merge goes through every entry with masks, a twentieth of a step at 512 robots; here
        what a reset hands out is whole already.
        """
        stepped = self.step(tensordict)
        after = self.step_mdp(stepped)
        done = after.get(keys.DONE)
        if done.any():
            self._start_episodes(done.flatten().nonzero().flatten())
            after.set(keys.OBSERVATION, self.observed).set(keys.PRIVILEGED, self.privileged)
            for key in specs.CLEARED_BY_RESET:
                after.set(key, after.get(key).masked_fill(done, 0))
        return stepped, after

    def _joint_target(self, action: Tensor) -> Tensor:
        return self._target_of_zero_action() + self.action_scale * action

    def _target_of_zero_action(self) -> Tensor:
        """What an action is relative to, rad: [23], or [num_envs, 23] where robots differ."""
        match self.settings.action:
            case "current_pose":
                return self.state.qpos[:, 7:]
            case "reference_pose":
                return self._coming_reference().qpos[:, 7:]
            case "reference_motion":
                # With a target that is ahead by velocity * kd / kp, the PD control damps only what
                # differs from the reference's velocity.
                coming = self._coming_reference()
                return coming.qpos[:, 7:] + self.damping_time_s * coming.qvel[:, 6:]
            case _:
                return self.default_joint_pos

    def _coming_reference(self) -> ReferenceFrame:
        """The reference that this step is to reach, with which its end is compared."""
        return self.reference.frame(self._frame_index() + 1)

    def take_unstable_states(self) -> dict[str, Tensor]:
        """States [n, ...] and actions from which simulations went wrong since the last call."""
        return self._unstable.take()

    def _frame_index(self) -> Tensor:
        index = self.start_frame + self.episode_step + self.settings.reference_lead
        return index.clamp(max=self.reference.num_frames - 1)

    def _phase(self, frame_index: Tensor) -> Tensor:
        """Phase of the motion within [0, 1], [n, 1] (Eq. 4 of the paper)."""
        return (frame_index / (self.reference.num_frames - 1))[:, None]

    def _observe(self, instant: Instant, action: Tensor, frame_index: Tensor) -> None:
        if self.settings.observation == "history":
            frame = observations.proprioception(instant, action, self.default_joint_pos)
            phase = self._phase(frame_index)
            self.observed = observations.next_history(frame, self.observed, phase)
        else:
            self.observed = observations.reference_observation(
                instant, action, self.default_joint_pos
            )
        self.privileged = observations.privileged_observation(instant)

    # --- resetting ---------------------------------------------------------------------------

    def _reset(self, tensordict: TensorDictBase | None, **_: object) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if self._resume_pending and mask is None:
            self._resume_pending = False
        else:
            everyone = torch.arange(self.batch_size[0], device=self.device)
            self._start_episodes(everyone if mask is None else everyone[mask.flatten()])
        return self._reset_output()

    def start_at(self, frames: Sequence[int]) -> None:
        """From now on every episode of robot i starts in frame ``frames[i]`` of the motion.

        Raises:
            ValueError: not one frame for each robot, or no episode can start there.
        """
        allowed = self.starts.num_starts
        if len(frames) != self.batch_size[0] or not all(0 <= frame < allowed for frame in frames):
            raise ValueError(
                f"start frames are {list(frames)}; needed are {self.batch_size[0]}, one for each "
                f"robot, from 0 to {allowed - 1}"
            )
        self._frames = torch.tensor(frames, dtype=torch.int64, device=self.device)

    def _start_episodes(self, env_ids: Tensor) -> None:
        if self._frames is None:
            start = self.starts.draw(len(env_ids), self.generator)
        else:
            start = self._frames.index_select(0, env_ids)
        reference = self.reference.frame(start)
        qpos, qvel = perturb(
            reference.qpos,
            reference.qvel,
            self.settings.reset_noise,
            self.limits.range_rad,
            self.generator,
        )
        self.physics.set_state(env_ids, qpos, qvel)
        self.state = self.physics.state()
        # Tensors that were handed out stay as they are: write into copies.
        self.start_frame = self.start_frame.index_copy(0, env_ids, start)
        self.episode_step = self.episode_step.index_fill(0, env_ids, 0)
        self.previous_action = self.previous_action.index_fill(0, env_ids, 0.0)
        self._observe_start(env_ids)

    def _observe_start(self, env_ids: Tensor) -> None:
        frame_index = self._frame_index().index_select(0, env_ids)
        instant = Instant(self.state.at(env_ids), self.reference.frame(frame_index), self.spec)
        action = self.previous_action.index_select(0, env_ids)
        if self.settings.observation == "history":
            frame = observations.proprioception(instant, action, self.default_joint_pos)
            observed = observations.first_history(frame, self._phase(frame_index))
        else:
            observed = observations.reference_observation(instant, action, self.default_joint_pos)
        privileged = observations.privileged_observation(instant)
        self.observed = self.observed.index_copy(0, env_ids, observed)
        self.privileged = self.privileged.index_copy(0, env_ids, privileged)

    def _reset_output(self) -> TensorDictBase:
        cleared = {
            key: torch.zeros(*self.batch_size, 1, dtype=dtype, device=self.device)
            for key, dtype in specs.CLEARED_BY_RESET.items()
        }
        return TensorDict(
            {keys.OBSERVATION: self.observed, keys.PRIVILEGED: self.privileged, **cleared},
            batch_size=self.batch_size,
            device=self.device,
        )

    def _set_seed(self, seed: int | None) -> None:
        self.generator.manual_seed(0 if seed is None else seed)

    # --- checkpoints -------------------------------------------------------------------------

    _BUFFERS = ("start_frame", "episode_step", "previous_action", "observed", "privileged")

    def simulation_state(self) -> dict[str, object]:
        """All that is needed to go on bit for bit, between two steps."""
        return {
            "physics": self.physics.state_dict(),
            "generator": self.generator.get_state(),
            "distance": self.distance.state_dict(),
            "starts": self.starts.state_dict(),
            "buffers": {name: getattr(self, name) for name in self._BUFFERS},
        }

    def restore_simulation(self, saved: Mapping[str, Any]) -> None:
        """Continue from ``simulation_state()``: the next full reset starts no new episode.

        A collector begins with a reset; after a restoration that one hands back the saved state.
        """
        self.physics.load_state_dict(saved["physics"])
        self.state = self.physics.state()
        self.generator.set_state(saved["generator"])
        self.distance.load_state_dict(saved["distance"])
        if "starts" in saved:  # runs of earlier versions had no adaptive starts
            self.starts.load_state_dict(saved["starts"])
        for name in self._BUFFERS:
            setattr(self, name, saved["buffers"][name].to(self.device))
        self._resume_pending = True


def _check_motion(reference: Reference, control_dt_s: float, lead: int) -> None:
    rate_hz = 1.0 / control_dt_s
    if abs(reference.fps - rate_hz) > 1e-6:
        raise ValueError(
            f"the motion has {reference.fps:g} frames a second, the control rate is "
            f"{rate_hz:g} Hz: resample the clip first"
        )
    if reference.num_frames < lead + 2:
        raise ValueError(
            f"a motion needs at least {lead + 2} frames, this one has {reference.num_frames}"
        )
