"""The recipes that are compared: what ``variants.yaml`` says."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

FILE = Path(__file__).with_name("variants.yaml")


@dataclass(frozen=True)
class Variant:
    """One recipe: the overrides of ``tlr-train`` that make it, and the question it answers."""

    name: str
    question: str
    overrides: tuple[str, ...]


def load_variants(names: list[str], file: Path = FILE) -> list[Variant]:
    """The variants of those names, or all where none is named.

    Raises:
        ValueError: a name that the file does not have.
    """
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    known = content["variants"]
    unknown = [name for name in names if name not in known]
    if unknown:
        raise ValueError(f"no variant {', '.join(unknown)}; there are {', '.join(known)}")
    return [
        Variant(name, known[name]["question"], (*content["base"], *_overrides(name, known)))
        for name in names or known
    ]


def _overrides(name: str, known: Mapping[str, Any]) -> list[str]:
    """What a variant changes, after what the variant changes that it is a variant of."""
    parent = known[name].get("of")
    inherited = _overrides(parent, known) if parent else []
    return [*inherited, *known[name]["overrides"]]
