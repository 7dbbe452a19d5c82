"""Any optimizer of mealpy by its name, contained and counted."""

import random
import sys
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
import torch
from configured import make
from landscapes import Recorder, uneven_bowl
from mealpy import FloatVar
from mealpy.swarm_based.PSO import OriginalPSO

PARAMETERS = {"c1": 1.5, "c2": 1.5, "w": 0.7}


def search_by(algorithm: str, **settings: Any) -> Any:
    return make("mealpy", num_terms=6, algorithm=algorithm, **settings)


def test_is_the_librarys_own_search() -> None:
    # The box in float64, so that positions are not rounded on the way.
    optimizer = search_by("OriginalPSO", parameters=PARAMETERS, iterations=20, budget=10_000)
    lower, upper = optimizer.task.lower.double(), optimizer.task.upper.double()
    optimizer.task = replace(optimizer.task, lower=lower, upper=upper)
    found = optimizer.search(uneven_bowl)
    seed = int(torch.randint(2**32, (1,), generator=torch.Generator().manual_seed(0)))
    problem = {
        "bounds": FloatVar(lb=(0.0,) * 6, ub=(1.0,) * 6),
        "obj_func": lambda x: uneven_bowl(torch.from_numpy(x)[None]).item(),
        "log_to": None,
        # As ours: else a position is spent on counting the values.
        "_n_objs": 1,
        "obj_weights": np.ones(1),
    }
    library = OriginalPSO(epoch=20, pop_size=30, **PARAMETERS)
    assert found.value == library.solve(problem, seed=seed).target.fitness
    assert found.evaluations == 30 * 21


@pytest.mark.parametrize("algorithm", ["OriginalGWO", "OriginalWOA", "L_SHADE", "OriginalABC"])
def test_whatever_the_algorithm_the_budget_is_kept(algorithm: str) -> None:
    recorder = Recorder(uneven_bowl)
    found = search_by(algorithm, budget=400, iterations=30).search(recorder)
    assert found.evaluations == recorder.calls <= 400
    assert found.value == torch.cat(recorder.values).min()


def test_an_unknown_algorithm_is_answered_with_similar_names() -> None:
    with pytest.raises(ValueError, match=r"no optimizer 'originalgwoo'; similar: OriginalGWO"):
        search_by("originalgwoo")
    with pytest.raises(ValueError, match=r"no optimizer 'qqqq'; it has: .*OriginalABC"):
        search_by("qqqq")


def test_an_algorithm_that_cannot_be_seeded_is_refused() -> None:
    with pytest.raises(ValueError, match="OriginalPSS cannot be seeded"):
        search_by("OriginalPSS")


def test_parameters_that_the_class_would_ignore_are_refused() -> None:
    with pytest.raises(ValueError, match=r"OriginalPSO has no parameter c3; it has: c1, c2, w"):
        search_by("OriginalPSO", parameters={"c3": 1.0})
    with pytest.raises(ValueError, match=r"mealpy's OriginalPSO: .*c1"):
        search_by("OriginalPSO", parameters={"c1": -1.0})


def test_without_the_package_it_says_how_to_get_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mealpy", None)
    with pytest.raises(ValueError, match=r"pip install -e '\.\[mealpy\]'"):
        search_by("OriginalPSO")


class GlobalPSO(OriginalPSO):
    """An algorithm that draws from the global generators."""

    def evolve(self, epoch: int) -> None:
        super().evolve(epoch)
        for agent in self.pop:
            solution = agent.solution + 0.1 * (np.random.rand(6) - random.random())  # noqa: NPY002
            agent.solution = self.correct_solution(solution)
            agent.target = self.get_target(agent.solution)


def test_global_generators_are_seeded_for_it_and_put_back() -> None:
    def found() -> torch.Tensor:
        optimizer = search_by("OriginalPSO", budget=300)
        optimizer.kind = GlobalPSO
        return optimizer.search(uneven_bowl).position

    first = found()
    kept = np.random.get_state(), random.getstate()  # noqa: NPY002
    np.random.seed(5)  # noqa: NPY002
    random.seed(5)
    try:
        before = np.random.get_state()[1].copy(), random.getstate()  # noqa: NPY002
        assert torch.equal(found(), first)
        assert (np.random.get_state()[1] == before[0]).all()  # noqa: NPY002
        assert random.getstate() == before[1]
    finally:
        np.random.set_state(kept[0])  # noqa: NPY002
        random.setstate(kept[1])
