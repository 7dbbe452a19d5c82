"""The motion-tracking environment: physics, a reference motion and the MDP's functions.

It reports raw reward terms and no reward: how terms are weighted is decided after collection
(``tlr_exp.reward.split``).
"""

from collections.abc import Mapping, Sequence
from typing import Any

import torch
from tensordict import TensorDict, TensorDictBase
from torch import Tensor
from torchrl.envs import EnvBase

from tlr_exp import keys
from tlr_exp.config.limits import check_env
from tlr_exp.config.settings import EnvSettings
from tlr_exp.env import observations, specs
from tlr_exp.env.actions import JointTargets
from tlr_exp.env.disturbances import Disturber
from tlr_exp.env.errors import tracking_errors
from tlr_exp.env.instability import UnstableStates
from tlr_exp.env.instant import Instant
from tlr_exp.env.noise import NoisySensors
from tlr_exp.env.recorded import RecordedTerms
from tlr_exp.env.resets import perturb
from tlr_exp.env.starts import StartFrames
from tlr_exp.env.terminations import TighteningDistance, far_from_reference, fell
from tlr_exp.env.transition import JointLimits, Transition
from tlr_exp.motion.reference import Reference
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
        potentials: terms, functions of the state, that are shown where a step begins, too.
        sigma_rate: at which sigmas of tracking terms follow the errors; None: they stay.
        start_frames: frames of the motion in which every episode of each robot starts, [num_envs];
            by default as ``settings`` say.
        saved: what ``simulation_state`` gave, to go on with: a collector begins with a reset, and
            the first one of all robots hands back the saved episodes and starts none.
        noise_seed, disturbance_seed: of the generators of noise on observations, and of the rest.

    Attributes:
        recorded, term_names: the reward terms, and their names in order.
        start_frame, episode_step: where each episode began and how far it is, [num_envs] int64.
        state: of the robots, after the last step or reset.
        reference: the motion, which is read ``settings.reference_lead`` frames ahead.
        joint_targets, limits: what actions mean, and what joints and motors allow.
        starts, distance: the frames in which episodes start, and the distance limit of episodes.
        sensors, disturber: what the actor sees of the robots, and what happens to them.

    Raises:
        UserError: a choice that does not exist, a motion or start frames that do not fit.
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
        potentials: Sequence[str] = (),
        sigma_rate: float | None = None,
        start_frames: Sequence[int] | None = None,
        saved: Mapping[str, Any] | None = None,
        noise_seed: int = 0,
        disturbance_seed: int = 0,
    ) -> None:
        super().__init__(device=physics.device, batch_size=torch.Size([physics.num_envs]))
        check_env(settings)
        reference.check(physics.control_dt, settings.reference_lead)
        self.physics = physics
        self.spec = robot.spec
        self.reference = reference
        self.settings = settings
        self.failures = failures
        self.joint_targets = JointTargets(settings.action, robot, self.device)
        self.limits = JointLimits.of(robot, self.device)
        self.recorded = RecordedTerms(terms, potentials, self.limits, sigma_rate)
        self.term_names = self.recorded.names
        self.distance = TighteningDistance(settings.termination, physics.num_envs, self.device)
        # The reference is read ahead, and an episode has one step at least.
        num_starts = reference.num_frames - 1 - settings.reference_lead
        self.starts = StartFrames(settings.start_phase, num_starts, reference.fps, self.device)
        self._start_frames = (
            None if start_frames is None else self.starts.checked(start_frames, physics.num_envs)
        )
        self.generator = torch.Generator(device=self.device).manual_seed(seed)
        self.sensors = NoisySensors(settings.noise, robot.spec, noise_seed, self.device)
        self.disturber = Disturber(settings.disturbance, robot, physics, disturbance_seed)
        self._make_specs()
        self._make_buffers()
        self._resumes = saved is not None
        if saved is not None:
            self._restore(saved)

    # --- specs and buffers -------------------------------------------------------------------

    def _make_specs(self) -> None:
        dim = observations.observation_dims(self.spec)[self.settings.observation]
        privileged_dim = observations.privileged_dim(self.spec)
        self.observation_spec = specs.observation_spec(
            self.batch_size, self.device, dim, privileged_dim, len(self.recorded.of_state)
        )
        self.action_spec = specs.action_spec(self.batch_size, self.device, self.spec.num_joints)
        num_terms = len(self.term_names)
        self.reward_spec = specs.reward_terms_spec(self.batch_size, self.device, num_terms)
        self.done_spec = specs.done_spec(self.batch_size, self.device)

    def _make_buffers(self) -> None:
        n, device = self.batch_size[0], self.device
        self.start_frame = torch.zeros(n, dtype=torch.int64, device=device)
        self.episode_step = torch.zeros(n, dtype=torch.int64, device=device)
        self.previous_action = torch.zeros(n, self.spec.num_joints, device=device)
        self.observed = self.observation_spec[keys.OBSERVATION].zero()
        self.privileged = self.observation_spec[keys.PRIVILEGED].zero()
        self.state_costs = torch.zeros(n, len(self.recorded.of_state), device=device)
        self.state: PhysicsState = self.physics.state()
        self._unstable = UnstableStates()

    # --- stepping ----------------------------------------------------------------------------

    def _step(self, tensordict: TensorDictBase) -> TensorDictBase:
        action = tensordict.get(keys.ACTION)
        before = self.state
        self._resumes = False
        self.episode_step = self.episode_step + 1
        frame_index = self._frame_index()
        reference = self.reference.frame(frame_index)
        target = self.joint_targets(action, before.qpos[:, 7:], reference)
        after = self.physics.step(self.disturber.deliver(target))
        self.state, unstable = self._unstable.replace(after, before, action)
        instant = Instant(self.state, reference, self.spec)
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
        terms = self.recorded.of_step(transition)
        self.state_costs = self.recorded.after(terms)
        phase = self._phase(frame_index)
        self.observed, self.privileged = self._observe(instant, action, phase, self.observed)
        self.previous_action = action
        return TensorDict(
            {
                **self._shown(),
                keys.REWARD_TERMS: terms,
                **tracking_errors(instant),
                keys.PHASE: phase,
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
            for key, value in self._shown().items():
                after.set(key, value)
            for key in specs.CLEARED_BY_RESET:
                after.set(key, after.get(key).masked_fill(done, 0))
        return stepped, after

    def _shown(self) -> dict[str, Tensor]:
        """What a step or a reset shows of the state that the robots are in."""
        costs = {keys.STATE_COSTS: self.state_costs} if self.recorded.of_state else {}
        return {keys.OBSERVATION: self.observed, keys.PRIVILEGED: self.privileged, **costs}

    def take_unstable_states(self) -> dict[str, Tensor]:
        """States [n, ...] and actions from which simulations went wrong since the last call."""
        return self._unstable.take()

    def _frame_index(self) -> Tensor:
        index = self.start_frame + self.episode_step + self.settings.reference_lead
        return index.clamp(max=self.reference.num_frames - 1)

    def _phase(self, frame_index: Tensor) -> Tensor:
        """Of the motion, within [0, 1] (Eq. 4 of the paper), [num_envs, 1]."""
        return (frame_index / (self.reference.num_frames - 1))[:, None]

    def _observe(
        self, instant: Instant, action: Tensor, phase: Tensor, before: Tensor | None = None
    ) -> tuple[Tensor, Tensor]:
        """What actor and critic see; ``before`` is what the actor saw a step ago, if it did."""
        default, kind = self.joint_targets.default_pos, self.settings.observation
        sensed = self.sensors(instant)
        seen = observations.actor_observation(kind, sensed, action, default, phase, before)
        return seen, observations.privileged_observation(instant)

    # --- resetting ---------------------------------------------------------------------------

    def _reset(self, tensordict: TensorDictBase | None, **_: object) -> TensorDictBase:
        mask = None if tensordict is None else tensordict.get("_reset", None)
        if self._resumes and mask is None:
            self._resumes = False
        else:
            everyone = torch.arange(self.batch_size[0], device=self.device)
            self._start_episodes(everyone if mask is None else everyone[mask.flatten()])
        return self._reset_output()

    def _start_episodes(self, env_ids: Tensor) -> None:
        if self._start_frames is None:
            start = self.starts.draw(len(env_ids), self.generator)
        else:
            start = self._start_frames.index_select(0, env_ids)
        reference = self.reference.frame(start)
        qpos, qvel = perturb(
            reference.qpos,
            reference.qvel,
            self.settings.reset_noise,
            self.limits.range_rad,
            self.generator,
        )
        self.disturber.begin(env_ids, qpos[:, 7:])
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
        observed, privileged = self._observe(instant, action, self._phase(frame_index))
        self.observed = self.observed.index_copy(0, env_ids, observed)
        self.privileged = self.privileged.index_copy(0, env_ids, privileged)
        if self.recorded.of_state:
            costs = self.recorded.at_start(instant, action)
            self.state_costs = self.state_costs.index_copy(0, env_ids, costs)

    def _reset_output(self) -> TensorDictBase:
        cleared = specs.cleared_entries(self.batch_size, self.device)
        return TensorDict(
            {**self._shown(), **cleared}, batch_size=self.batch_size, device=self.device
        )

    def _set_seed(self, seed: int | None) -> None:
        for part in (self, self.sensors, self.disturber):
            part.generator.manual_seed(0 if seed is None else seed)

    # --- checkpoints -------------------------------------------------------------------------

    _BUFFERS = ("start_frame", "episode_step", "previous_action", *specs.SHOWN_OF_STATE)

    def simulation_state(self) -> dict[str, object]:
        """All that is needed to go on bit for bit, between two steps: a new one's ``saved``."""
        return {
            "physics": self.physics.state_dict(),
            "generator": self.generator.get_state(),
            "distance": self.distance.state_dict(),
            "starts": self.starts.state_dict(),
            "noise": self.sensors.generator.get_state(),
            "disturbance": self.disturber.state_dict(),
            "recorded": self.recorded.state_dict(),
            "buffers": {name: getattr(self, name) for name in self._BUFFERS},
        }

    def _restore(self, saved: Mapping[str, Any]) -> None:
        if "noise" in saved:  # runs of earlier versions had neither
            self.sensors.generator.set_state(saved["noise"])
            self.disturber.load_state_dict(saved["disturbance"])
        self.physics.load_state_dict(saved["physics"])
        self.state = self.physics.state()
        self.generator.set_state(saved["generator"])
        self.distance.load_state_dict(saved["distance"])
        if "starts" in saved:  # runs of earlier versions had no adaptive starts
            self.starts.load_state_dict(saved["starts"])
        self.recorded.load_state_dict(saved.get("recorded", {}))
        for name, value in saved["buffers"].items():  # those of earlier versions lack state costs
            setattr(self, name, value.to(self.device))
