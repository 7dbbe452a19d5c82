"""A new run that begins with the policy of a checkpoint (``init_from``)."""

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from torch import Tensor, nn

from tlr_exp.assembly.learner import build_ppo
from tlr_exp.assembly.robot import spec_of
from tlr_exp.config.input_files import INITIAL
from tlr_exp.config.load import ConfigError
from tlr_exp.config.nested import value_at
from tlr_exp.config.settings import Settings
from tlr_exp.config.versions import of_any_version
from tlr_exp.env.observations import observation_dims
from tlr_exp.ppo.learner import Ppo
from tlr_exp.records.checkpoint import CheckpointError, load_checkpoint
from tlr_exp.records.checkpoint_files import initial_checkpoint
from tlr_exp.records.run_directory import RunDirectory, RunDirectoryError

ACTOR, CRITIC = "actor", "critic"
# What gives the same weights another meaning.
_MEANING = ("env.observation", "ppo.activation")
_ACTION = "env.action"

State = Mapping[str, Tensor]


def check_initial_policy(settings: Settings) -> None:
    """Refuse a checkpoint whose networks are not those of ``settings``; nothing without one.

    What is worth knowing of one that fits is printed.

    Raises:
        ConfigError: there is no such checkpoint, it cannot be read, or it holds other networks
            (names in what they differ).
    """
    if settings.init_from is None:
        return
    try:
        path = initial_checkpoint(Path(settings.init_from))
        networks = _networks(path)
        # On the CPU and before anything is made: only shapes are looked at.
        ppo = build_ppo(dataclasses.replace(settings, device="cpu"))
    except ValueError as error:
        raise ConfigError(f"{INITIAL}: {error}") from error
    config = _configuration_beside(path)
    problems = [*_other_networks(networks, ppo, settings)]
    problems += _other_meanings(config, settings, problems)
    if problems:
        text = "\n".join(f"  {problem}" for problem in problems)
        raise ConfigError(f"{INITIAL}: the policy of {path} does not fit this run:\n{text}")
    action = None if config is None else value_at(config, _ACTION)
    if action not in (None, settings.env.action):
        print(f"{path} learned with {_ACTION}={action}; here it is {settings.env.action}")


def begin_with(ppo: Ppo, path: Path) -> str:
    """Give ``ppo`` the networks and the normalisation of a checkpoint, and nothing else of it.

    Returns:
        What was taken, in words.

    Raises:
        CheckpointError: it cannot be read, or holds other networks.
    """
    networks = _networks(path)
    try:
        ppo.actor.load_state_dict(dict(networks[ACTOR]))
        if CRITIC in networks:
            ppo.critic.load_state_dict(dict(networks[CRITIC]))
    except RuntimeError as error:
        raise CheckpointError(f"{path} holds other networks ({_first_line(error)})") from error
    if CRITIC in networks:
        return f"begins with the policy and the critic of {path}"
    return f"begins with the policy of {path}, which holds no critic: that one is new"


def _networks(path: Path) -> dict[str, State]:
    """The weights of the actor and, where the checkpoint has one, of the critic.

    Raises:
        CheckpointError: it cannot be read, or holds no actor.
    """
    state: Any = load_checkpoint(path)
    for name in ("trainer", "ppo"):
        state = state.get(name) if isinstance(state, Mapping) else None
    if not isinstance(state, Mapping) or not isinstance(state.get(ACTOR), Mapping):
        raise CheckpointError(f"{path} holds no policy")
    return {name: state[name] for name in (ACTOR, CRITIC) if state.get(name)}


def _configuration_beside(path: Path) -> dict[str, Any] | None:
    """The configuration of the run that a checkpoint lies in; None where it lies alone."""
    try:
        return of_any_version(RunDirectory(path.absolute().parent.parent).config)
    except RunDirectoryError:
        return None


# --- what differs ----------------------------------------------------------------------------


def _other_meanings(
    config: dict[str, Any] | None, settings: Settings, told: Sequence[str]
) -> list[str]:
    """A line for each key that is known to differ and that no line in ``told`` speaks of."""
    if config is None:
        return []
    here = dataclasses.asdict(settings)
    pairs = {key: (value_at(config, key), value_at(here, key)) for key in _MEANING}
    return [
        f"{key} is {there} there, {own} here"
        for key, (there, own) in pairs.items()
        if there not in (None, own) and not any(key in line for line in told)
    ]


def _other_networks(networks: dict[str, State], ppo: Ppo, settings: Settings) -> Iterator[str]:
    """One line for each way in which the actor differs from that of ``ppo``; else, the critic."""
    here = {ACTOR: ppo.actor, CRITIC: ppo.critic}
    for name, there in networks.items():
        found = list(_other_layers(name, there, here[name].state_dict(), settings))
        if not found and (reason := _refusal(here[name], there)):
            found = [f"its {name} is built otherwise: {reason}"]
        yield from found
        if found:
            return


def _other_layers(name: str, there: State, own: State, settings: Settings) -> Iterator[str]:
    sizes, own_sizes = _sizes(there), _sizes(own)
    if not sizes:
        yield f"its {name} has no layers"
        return
    if sizes[0] != own_sizes[0] and name == ACTOR:
        known = [
            key for key, dim in observation_dims(spec_of(settings.env)).items() if dim == sizes[0]
        ]
        hint = f" (env.observation={known[0]})" if known else ""
        yield (
            f"it sees {sizes[0]} numbers{hint}, "
            f"env.observation={settings.env.observation} has {own_sizes[0]}"
        )
    elif sizes[0] != own_sizes[0]:
        yield f"its {name} sees {sizes[0]} numbers, that of this run {own_sizes[0]}"
    if name == ACTOR and (learned := _learned_std(there)) != (own_std := _learned_std(own)):
        yield f"ppo.std is {learned} there, {own_std} here"
    if sizes[1:-1] != own_sizes[1:-1]:
        yield f"ppo.hidden_sizes is {sizes[1:-1]} there, {own_sizes[1:-1]} here"
    if sizes[-1] != own_sizes[-1]:
        yield f"its {name} gives {sizes[-1]} numbers, that of this run {own_sizes[-1]}"
    if _is_normalised(there) != _is_normalised(own):
        words = [str(_is_normalised(state)).lower() for state in (there, own)]
        yield f"ppo.normalize_observations is {words[0]} there, {words[1]} here"


def _sizes(state: State) -> list[int]:
    """Inputs, hidden layers and outputs of a perceptron, from its weight matrices in order."""
    matrices = [value for value in state.values() if value.ndim == 2]
    return [matrices[0].shape[1], *(len(matrix) for matrix in matrices)] if matrices else []


def _is_normalised(state: State) -> bool:
    return any(name.endswith(".variance") for name in state)


def _learned_std(actor: State) -> str:
    """As what an actor learns its standard deviation (the key ppo.std)."""
    return "linear" if any(name.endswith(".std") for name in actor) else "log"


def _refusal(network: nn.Module, state: State) -> str | None:
    try:
        network.load_state_dict(dict(state))
    except RuntimeError as error:
        return _first_line(error)
    return None


def _first_line(error: Exception) -> str:
    lines = [line.strip() for line in str(error).splitlines()]
    return lines[1] if len(lines) > 1 else lines[0]  # PyTorch names the class first
