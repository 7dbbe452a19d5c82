"""Actor and critic: multilayer perceptrons behind a running normalisation of what they see."""

from collections.abc import Iterator
from contextlib import contextmanager

import torch
from tensordict.nn import TensorDictModule
from torch import Tensor, nn
from torchrl.modules import MLP, IndependentNormal, ProbabilisticActor, ValueOperator

from tlr_exp import keys
from tlr_exp.config.settings import PpoSettings
from tlr_exp.machine.precision import BFLOAT16, FLOAT32

ACTIVATIONS: dict[str, type[nn.Module]] = {"elu": nn.ELU, "relu": nn.ReLU, "tanh": nn.Tanh}

SMALLEST_STD = (
    1e-3  # of a policy whose standard deviation is learned linearly: it must stay positive
)


class RunningNorm(nn.Module):
    """Normalises by the mean and variance of all batches that it was updated with.

    Updated once an iteration, from the collected batch, so that one policy collects one batch;
    frozen at evaluation by not being updated. Statistics are kept in float64 and are exact:
    batches are merged by Chan's formula.
    """

    mean: Tensor
    variance: Tensor
    count: Tensor
    shift: Tensor
    scale: Tensor

    def __init__(self, size: int, clip: float = 10.0) -> None:
        super().__init__()
        self.clip = clip
        self.register_buffer("mean", torch.zeros(size, dtype=torch.float64))
        self.register_buffer("variance", torch.ones(size, dtype=torch.float64))
        self.register_buffer("count", torch.zeros((), dtype=torch.float64))
        self.register_buffer("shift", torch.zeros(size))
        self.register_buffer("scale", torch.ones(size))

    def forward(self, value: Tensor) -> Tensor:
        # In place after the first step: these passes over memory are a tenth of an update.
        return (value - self.shift).mul_(self.scale).clamp_(-self.clip, self.clip)

    @torch.no_grad()
    def update(self, batch: Tensor) -> None:
        """Take in ``batch`` [..., size]."""
        rows = batch.reshape(-1, batch.shape[-1])
        variance, mean = torch.var_mean(rows, dim=0, correction=0)
        total = self.count + len(rows)
        delta = mean.double() - self.mean
        between = delta.square() * self.count * len(rows) / total
        spread = self.variance * self.count + variance.double() * len(rows) + between
        self.mean += delta * len(rows) / total
        self.variance.copy_(spread / total)
        self.count.copy_(total)
        self.shift.copy_(self.mean)
        self.scale.copy_((self.variance + 1e-5).rsqrt())


class MixedPrecisionMlp(MLP):
    """A multilayer perceptron whose hidden layers multiply in ``precision``; see ``set_precision``.

    In bfloat16, parameters, sums of products and outputs stay float32, too (PyTorch's autocast),
    and so does the last layer: eight binary digits do not tell a value from that of the next state.
    """

    precision = FLOAT32

    def forward(self, value: Tensor) -> Tensor:  # type: ignore[override]  # one input, not many
        *hidden, last = self
        lower = self.precision == BFLOAT16
        with torch.autocast(value.device.type, torch.bfloat16, enabled=lower):
            for layer in hidden:
                value = layer(value)
        return last(value.float())


class GaussianHead(nn.Module):
    """Adds a standard deviation, the same in every state, to the mean [..., size].

    It is learned as its logarithm or, as in ASAP, ``linear``, where it cannot fall below
    ``SMALLEST_STD``; one that has come there has no gradient any more, and stays.
    """

    def __init__(self, size: int, initial_std: float, learned: str = "log") -> None:
        super().__init__()
        std = torch.full((size,), initial_std)
        self.is_linear = learned == "linear"
        if self.is_linear:
            self.std = nn.Parameter(std)
        else:
            self.log_std = nn.Parameter(std.log())

    def forward(self, mean: Tensor) -> tuple[Tensor, Tensor]:
        std = self.std.clamp(min=SMALLEST_STD) if self.is_linear else self.log_std.exp()
        return mean, std.expand_as(mean)


class JoinedInputs(nn.Module):
    """Feeds the concatenation of its inputs to ``module``."""

    def __init__(self, module: nn.Module) -> None:
        super().__init__()
        self.module = module

    def forward(self, *inputs: Tensor) -> Tensor:
        return self.module(torch.cat(inputs, dim=-1))


def build_actor(
    observation_dim: int,
    action_dim: int,
    settings: PpoSettings,
    generator: torch.Generator | None = None,
) -> ProbabilisticActor:
    """The Gaussian policy: writes ``loc``, ``scale``, ``action`` and ``action_log_prob``.

    ``generator`` draws the exploration noise; it must live on the device of the policy.
    """
    body = nn.Sequential(
        _norm(observation_dim, settings),
        _mlp(observation_dim, action_dim, settings),
        GaussianHead(action_dim, settings.initial_std, settings.std),
    )
    return ProbabilisticActor(
        TensorDictModule(body, in_keys=[keys.OBSERVATION], out_keys=["loc", "scale"]),
        in_keys=["loc", "scale"],
        out_keys=[keys.ACTION],
        distribution_class=IndependentNormal,
        return_log_prob=True,
        generator=generator,
    )


def build_critic(observation_dim: int, privileged_dim: int, settings: PpoSettings) -> ValueOperator:
    """The value function of observation and privileged observation: ``state_value`` [..., 1]."""
    width = observation_dim + privileged_dim
    body = nn.Sequential(_norm(width, settings), _mlp(width, 1, settings))
    return ValueOperator(JoinedInputs(body), in_keys=[keys.OBSERVATION, keys.PRIVILEGED])


def update_norms(network: nn.Module, batch: Tensor) -> None:
    """Take ``batch`` [..., inputs of the network] into its running normalisation, if it has one."""
    for module in network.modules():
        if isinstance(module, RunningNorm):
            module.update(batch)


def set_precision(network: nn.Module, precision: str) -> None:
    """Let ``network`` multiply in ``float32`` or ``bfloat16``, acting and learning."""
    for module in network.modules():
        if isinstance(module, MixedPrecisionMlp):
            module.precision = precision


@contextmanager
def in_float32(network: nn.Module) -> Iterator[None]:
    """For a while, let ``network`` multiply in full precision: how policies are judged."""
    before = {m: m.precision for m in network.modules() if isinstance(m, MixedPrecisionMlp)}
    set_precision(network, FLOAT32)
    try:
        yield
    finally:
        for module, precision in before.items():
            module.precision = precision


@contextmanager
def noted_features(network: nn.Module) -> Iterator[list[Tensor]]:
    """A list that gets what the last layer of ``network`` sees, pass by pass [n, num_features]."""
    *_, last = (module for module in network.modules() if isinstance(module, nn.Linear))
    seen: list[Tensor] = []
    hook = last.register_forward_pre_hook(lambda _module, inputs: seen.append(inputs[0]))
    try:
        yield seen
    finally:
        hook.remove()


def _norm(size: int, settings: PpoSettings) -> nn.Module:
    return RunningNorm(size) if settings.normalize_observations else nn.Identity()


def _mlp(inputs: int, outputs: int, settings: PpoSettings) -> MixedPrecisionMlp:
    return MixedPrecisionMlp(
        in_features=inputs,
        out_features=outputs,
        num_cells=list(settings.hidden_sizes),
        activation_class=ACTIVATIONS[settings.activation],
    )
