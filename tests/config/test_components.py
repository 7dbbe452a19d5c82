"""Parts are built by what they say themselves, of the user's own no less than the project's."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import pytest

from tlr_exp.config.checks import SettingError, check_at_least
from tlr_exp.config.components import check_component, instantiate
from tlr_exp.config.load import ConfigError


class Steps:
    """An optimizer of a user's own, whose settings are called like others' that have limits."""

    def __init__(
        self,
        seed: int,
        scale: float,
        pack_size: int = 1,
        kind: Literal["up", "down"] = "up",
        strategy: Mapping[str, float] | None = None,
        make: Callable[..., Any] | None = None,
        within: "Share | None" = None,
    ) -> None:
        self.seed, self.scale, self.pack_size = seed, scale, pack_size
        self.kind, self.strategy, self.make, self.within = kind, strategy, make, within


class LongSteps(Steps):
    """One that passes the rest on, and gives the base something itself."""

    def __init__(self, *arguments: Any, length: float, **settings: Any) -> None:
        super().__init__(*arguments, scale=length, **settings)
        check_at_least("length", length, 1.0)


@dataclass(kw_only=True)
class Share:
    share: float

    def __post_init__(self) -> None:
        if self.share > 1.0:
            raise SettingError(f"share is {self.share}; allowed: at most 1")


class Slow:
    """A part that takes long to build."""

    def __init__(self, seed: int, threads: int) -> None:
        raise AssertionError("it is not to be built")

    @staticmethod
    def check_settings(threads: int) -> None:
        check_at_least("threads", threads, 1)


def breaks_down(seed: int) -> int:
    """A part with a mistake of its own."""
    return len(seed)  # type: ignore[arg-type]


def node(part: Callable[..., Any], **settings: Any) -> dict[str, Any]:
    return {"_target_": f"{__name__}.{part.__name__}", **settings}


def test_a_part_of_the_users_own_is_bound_by_no_limit_of_another_part():
    built = instantiate("optimizer", node(Steps, scale=5, pack_size=2), seed=3)
    assert (built.seed, built.scale, built.pack_size) == (3, 5, 2)


def test_what_is_built_gets_its_arguments_as_they_are(robot):
    assert instantiate("x", {"_target_": "builtins.dict"}, robot=robot)["robot"] is robot
    assert instantiate("x", node(Steps, scale=1.0), seed=robot).seed is robot


@pytest.mark.parametrize(
    ("part", "settings", "words"),
    [
        (Steps, {}, "optimizer.scale is missing; Steps needs it"),
        (Steps, {"scale": "big"}, "optimizer.scale is 'big'; allowed: a number"),
        (Steps, {"scale": True}, "optimizer.scale is True; allowed: a number"),
        (Steps, {"scale": 1.0, "pack_size": 2.5}, "optimizer.pack_size is 2.5; allowed: a whole"),
        (Steps, {"scale": 1.0, "kind": "on"}, "optimizer.kind is 'on'; allowed: up, down"),
        (Steps, {"scale": 1.0, "strategy": 7}, "strategy is 7; allowed: a mapping or null"),
        (Steps, {"scale": 1.0, "make": 7}, "make is 7; allowed: a part with _partial_: true or n"),
        (Steps, {"scale": 1.0, "scael": 1}, "no key optimizer.scael. Did you mean scale? Allowed"),
        (LongSteps, {"length": 2.0, "packsize": 1}, "optimizer.packsize. Did you mean pack_size?"),
        (LongSteps, {"length": 0.5}, "optimizer.length is 0.5; allowed: at least 1"),
        (LongSteps, {"length": 2.0, "pack_size": "a"}, "optimizer.pack_size is 'a'; allowed: a wh"),
    ],
)
def test_settings_are_compared_with_the_signature_of_the_part(part, settings, words):
    with pytest.raises(ConfigError) as error:
        instantiate("optimizer", node(part, **settings), seed=0)
    assert words in str(error.value)


def test_all_that_does_not_fit_is_told_together():
    with pytest.raises(ConfigError) as error:
        instantiate("optimizer", node(Steps, pack_size="a", colour=1), seed=0)
    assert len(str(error.value).splitlines()) == 3  # and scale is missing


def test_arguments_that_a_part_does_not_take_are_told_before_it_is_called():
    with pytest.raises(ConfigError, match=r"^optimizer: Steps does not take device"):
        instantiate("optimizer", node(Steps, scale=1.0), seed=0, device="cpu")


def test_parts_within_are_told_by_their_own_keys():
    within = node(Share, share=0.5)
    assert instantiate("x", node(Steps, scale=1.0, within=within), seed=0).within.share == 0.5
    make = instantiate("x", node(Steps, scale=1.0, make={**within, "_partial_": True}), seed=0).make
    assert make().share == 0.5
    with pytest.raises(ConfigError, match=r"^x\.make\.share is 2\.0; allowed: at most 1"):
        make(share=2.0)
    with pytest.raises(ConfigError, match=r"^x\.within\.share is 3; allowed: at most 1"):
        instantiate("x", node(Steps, scale=1.0, within=node(Share, share=3)), seed=0)


def test_a_mistake_of_the_part_itself_is_no_error_of_the_configuration():
    with pytest.raises(TypeError, match=r"object of type 'int' has no len"):
        instantiate("optimizer", node(breaks_down), seed=0)


@pytest.mark.parametrize(
    ("target", "words"),
    [
        ("tlr_exp.optimizer.nothing.Nothing", r"x\._target_ is tlr_exp\.optimizer\.nothing"),
        (None, r"x\._target_ is None; it must name a class"),
    ],
)
def test_a_class_that_does_not_exist_is_an_error_of_the_configuration(target, words):
    with pytest.raises(ConfigError, match=words):
        instantiate("x", {"_target_": target})


def test_what_is_slow_to_build_is_checked_without():
    check_component("physics", node(Slow, threads=2), seed=0)
    with pytest.raises(ConfigError, match=r"^physics\.threads is 0; allowed: at least 1"):
        check_component("physics", node(Slow, threads=0), seed=0)
    with pytest.raises(ConfigError, match=r"^physics\.threads is 'a'; allowed: a whole number"):
        check_component("physics", node(Slow, threads="a"), seed=0)
    check_component("physics", node(Share, share=2))  # only building it would tell
    with pytest.raises(ConfigError, match=r"^physics\.share is 'a'; allowed: a number"):
        check_component("physics", node(Share, share="a"))
