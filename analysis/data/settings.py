"""Configurations compared: which keys may differ, which do, and what to call the arms."""

import difflib
import json
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any

from analysis.data.runs import RunRecord
from tlr_exp.config.checks import is_number
from tlr_exp.config.nested import covers, flat, value_at
from tlr_exp.config.words import WORDS

OPTIMIZER = "optimizer"  # the arm key that stands for the optimizer by its name
SEED = "seed"
RECIPE = "recipe"  # runs from before it had a name learned by the paper's

# Of the keys that do not change what is learned (NOT_IDENTITY), those that change what is
# measured, and so are said.
TOLD = (
    *("num_threads", "physics.num_threads", "precision"),
    *("scale.evaluate_every", "scale.evaluate_starts"),
)

ABSENT = object()  # in place of the value of a key that a configuration does not have


def unknown_keys(records: Sequence[RunRecord], keys: Iterable[str]) -> Iterator[str]:
    """One line per key that no run's configuration has, with the nearest that there is."""
    known = {name for record in records for name in flat(record.comparable)}
    parts = [name.split(".") for name in known]
    groups = {".".join(path[:depth]) for path in parts for depth in range(1, len(path))}
    for key in keys:
        if key not in known | groups:
            close = difflib.get_close_matches(key, sorted(known | groups), n=1)
            by_end = sorted(name for name in known if name.endswith(f".{key}"))
            hint = [f"; did you mean {name}?" for name in (*by_end, *close)][:1]
            yield f"no run has the configuration key {key}{''.join(hint)}"


def arm_labels(records: Sequence[RunRecord], arm_keys: Sequence[str]) -> list[str]:
    """What to call the arm of each run: the method, then those other keys that differ.

    "gwo", or "gwo, threshold_share=0.02" where arms differ in reward.objective.threshold_share.
    """
    differing = [
        key
        for key in arm_keys
        if key != OPTIMIZER and len({_arm_text(record, key) for record in records}) > 1
    ]
    ends = Counter(key.rpartition(".")[2] for key in differing)
    labels = []
    for record in records:
        parts = [record.method] if OPTIMIZER in arm_keys or not differing else []
        for key in differing:
            end = key.rpartition(".")[2]
            if (text := _arm_text(record, key)) is not None:
                parts.append(f"{end if ends[end] == 1 else key}={text}")
        labels.append(", ".join(parts) or record.method)
    return labels


def labelled_keys(records: Sequence[RunRecord], arms: Iterable[str]) -> list[str]:
    """The configuration keys that the labels of `arm_labels` speak of, and the optimizer."""
    parts = [part.strip().partition("=") for arm in arms for part in arm.split(",")]
    names = {name for name, equals, _ in parts if equals}
    paths = [key.split(".") for record in records for key in flat(record.comparable)]
    known = {".".join(path[:depth]) for path in paths for depth in range(1, len(path) + 1)}
    told = sorted(key for key in known if {key, key.rpartition(".")[2]} & names)
    return [OPTIMIZER, *told]


def _arm_text(record: RunRecord, key: str) -> str | None:
    """The value of an arm key in a label: an exchangeable part by the name of its class."""
    if key == OPTIMIZER:
        return record.method
    value = value_at(record.comparable, key)
    if isinstance(value, Mapping) and isinstance(value.get("_target_"), str):
        return value["_target_"].rpartition(".")[2]
    return None if value is None else text_of(value)


def text_of(value: Any) -> str:
    """A value of a configuration as it is written on a command line."""
    if value is ABSENT:
        return "absent"
    return value if isinstance(value, str) else json.dumps(value)


def differences(
    records: Sequence[RunRecord], arm_keys: Sequence[str], ignored: Sequence[str]
) -> Iterator[str]:
    """One line per run and key whose value is not that of most runs it must agree with.

    Not compared are the seed, the arm keys and the `ignored` ones. Settings within a group that is
    an arm key, such as the optimizer's, or that an arm key stands for, such as those of a recipe,
    are compared between runs that have the same there.
    """
    configs = [flat(record.comparable) for record in records]
    for key in dict.fromkeys(name for config in configs for name in config):
        if key == SEED or key in arm_keys or covers(ignored, key):
            continue
        groups: dict[tuple, list[int]] = {}
        above = [each for each in arm_keys if covers([each, *WORDS.get(each, ())], key)]
        for index, record in enumerate(records):
            same = tuple(_arm_text(record, each) for each in above)
            groups.setdefault(same, []).append(index)
        for members in groups.values():
            yield from _deviations(
                key, [(records[i].name, configs[i].get(key, ABSENT)) for i in members]
            )


def _deviations(key: str, values: Sequence[tuple[str, Any]]) -> Iterator[str]:
    kinds = [_comparable(value) for _, value in values]
    standard, count = Counter(kinds).most_common(1)[0]
    if count == len(values):
        return
    example, usual = values[kinds.index(standard)]
    rest = f" and {count - 1} more" if count > 1 else ""
    for (name, value), kind in zip(values, kinds, strict=True):
        if kind != standard:
            yield f"{name}: {key} is {text_of(value)}, but {text_of(usual)} in {example}{rest}"


def _comparable(value: Any) -> str:
    """Equal for values that mean the same: 1 and 1.0 do, "1" and 1 do not.

    null is as good as absent, as in runs of versions that did not have the key yet.
    """
    if isinstance(value, list):
        return f"[{','.join(map(_comparable, value))}]"
    if is_number(value):
        return repr(float(value))
    return "" if value is ABSENT or value is None else json.dumps(value)


def told_differences(records: Sequence[RunRecord], keys: Iterable[str]) -> Iterator[str]:
    """One sentence per key that differs, though runs that differ in it may be compared."""
    configs = [flat(record.comparable) for record in records]
    names = sorted({name for config in configs for name in config if covers(keys, name)})
    for key in names:
        values = [text_of(config.get(key, ABSENT)) for config in configs]
        yield from spread(f"{key} differs", values, [record.name for record in records])


def spread(what: str, values: Sequence[str], names: Sequence[str]) -> Iterator[str]:
    """A sentence on `values` of runs, if they differ: the usual one, and the runs that deviate."""
    counts = Counter(values)
    if len(counts) < 2:
        return
    (most, number), *others = counts.most_common()
    parts = [f"{most or 'not known'} in {number} runs"]
    for value, count in others:
        runs = [name for name, each in zip(names, values, strict=True) if each == value]
        more = f" and {count - 3} more" if count > 3 else ""
        parts.append(f"{value or 'not known'} in {', '.join(runs[:3])}{more}")
    yield f"{what}: {'; '.join(parts)}"
