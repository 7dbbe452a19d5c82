"""CMA-ES: the library's own search, told and asked as it would be by hand."""

from typing import Any

import numpy as np
import pytest
import torch
from cmaes import CMA
from configured import make
from landscapes import Recorder, box, constant
from torch import Tensor

from tlr_exp.optimizer import cma_es
from tlr_exp.optimizer.cma_es import cma_search
from tlr_exp.optimizer.gwo import grey_wolf_search
from tlr_exp.optimizer.search import SearchResult


def ridge(x: Tensor) -> Tensor:
    """Minimum 0 at 0.6; a thousand times steeper across the axes than along them."""
    y = x - 0.6
    turned = torch.stack(
        [y[:, 0] + y[:, 1], y[:, 0] - y[:, 1], y[:, 2] + y[:, 3], y[:, 2] - y[:, 3]]
    )
    return (turned.square() * torch.tensor([1.0, 1e3, 1.0, 1e3])[:, None]).sum(dim=0)


def search(
    function: Any,
    seed: int = 0,
    iterations: int = 50,
    dims: int = 4,
    start: Tensor | None = None,
    separable: bool = False,
) -> SearchResult:
    task = box(0.0, 1.0, dims, seed, start=start)
    sizes = {"pack_size": 30, "iterations": iterations}
    return cma_search(function, task, **sizes, initial_std=0.3, separable=separable, resampling=5)


def test_is_the_library_asked_and_told() -> None:
    recorder = Recorder(ridge)
    found = search(recorder, iterations=12, start=torch.full((1, 4), 0.5))
    seed = int(torch.randint(2**32, (1,), generator=torch.Generator().manual_seed(0)))
    library = CMA(
        mean=np.full(4, 0.5),
        sigma=0.3,
        bounds=np.array([[0.0, 1.0]] * 4),
        n_max_resampling=5,
        seed=seed,
        population_size=30,
    )
    best = np.inf
    for pack in recorder.packs:
        samples = np.stack([library.ask() for _ in range(30)])
        np.testing.assert_array_equal(pack.numpy(), samples)
        values = ridge(torch.from_numpy(samples)).numpy()
        best = min(best, values.min())
        library.tell(list(zip(samples, values, strict=True)))
    assert found.value == best


@pytest.mark.parametrize("separable", [False, True])
def test_adapts_to_a_valley_that_wolves_do_not_see(separable: bool) -> None:
    found = [search(ridge, seed, separable=separable).value for seed in range(3)]
    wolves = [
        grey_wolf_search(ridge, box(0.0, 1.0, 4, seed), pack_size=30, iterations=50).value
        for seed in range(3)
    ]
    if separable:  # it sees the axes only
        assert max(found) < 1.0
    else:
        assert max(found) < 1e-3 * min(wolves)


def test_separable_in_one_dimension_is_cma() -> None:
    one, other = (
        search(lambda x: (x[:, 0] - 0.3).square(), dims=1, separable=separable)
        for separable in (True, False)
    )
    assert torch.equal(one.position, other.position)
    assert one.value < 1e-10


def test_starts_anew_where_all_values_are_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    means = []

    class Counting(CMA):
        def __init__(self, **settings: Any) -> None:
            means.append(settings["mean"])
            super().__init__(**settings)

    monkeypatch.setattr(cma_es, "CMA", Counting)
    found = search(constant)
    assert found.evaluations == 30 * 51
    assert len(means) > 1
    assert not np.array_equal(means[0], means[1])


def test_a_warm_start_begins_at_the_last_weights() -> None:
    optimizer = make("cma_es", num_terms=4, warm_start=True, initial_std=0.01)
    optimizer.last_weights = torch.tensor([0.2, 0.4, 0.6, 0.8])
    recorder = Recorder(ridge)
    optimizer.search(recorder)
    torch.testing.assert_close(
        recorder.packs[0].mean(dim=0), optimizer.last_weights, atol=0.02, rtol=0.0
    )


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"pack_size": 3}, "pack_size is 3; allowed: at least 4"),
        ({"initial_std": 0.0}, r"initial_std is 0\.0; allowed: from 1e-06 to 1"),
        ({"separable": "no"}, "separable is 'no'; allowed: true or false"),
        ({"resampling": 0}, "resampling is 0; allowed: at least 1"),
    ],
)
def test_bad_settings_are_refused(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make("cma_es", **settings)
