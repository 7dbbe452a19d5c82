"""Checks whether settings fit a part's arguments: their names, what is needed, and types."""

import inspect
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from inspect import Parameter
from types import NoneType, UnionType
from typing import Any, Literal, Union, get_args, get_origin

from tlr_exp.config.checks import no_such_key

_BY_NAME = (Parameter.POSITIONAL_OR_KEYWORD, Parameter.KEYWORD_ONLY)
_WORDS = {  # of the types that are compared
    **{bool: "true or false", int: "a whole number", float: "a number", str: "text"},
    **{dict: "a mapping", Mapping: "a mapping", list: "a list", Sequence: "a list"},
    **{None: "null", NoneType: "null", Callable: "a part with _partial_: true"},
}


def argument_problems(
    key: str, part: Callable[..., Any], settings: Mapping[str, Any], given: Iterable[str]
) -> list[str]:
    """One line for each setting, or argument that is given besides, that a part has no place for.

    Args:
        key: where the part stands in the configuration.
        part: a class, of the user's own perhaps, or a function.
        settings: of the configuration; their types are compared with the annotations.
        given: names of the arguments that every part in this place is given.
    """
    parameters, takes_any = _parameters(part)
    names = [*settings, *given]
    places = [name for name in parameters if name not in given]
    problems = []
    if not takes_any:
        unknown = [name for name in settings if name not in parameters]
        problems += [no_such_key(f"{key}.{name}", places) for name in unknown]
        problems += [
            f"{key}: {part.__qualname__} does not take {name}, which every part here is given"
            for name in given
            if name not in parameters
        ]
    for name, parameter in parameters.items():
        kind = parameter.annotation
        if name not in names and parameter.default is Parameter.empty:
            problems.append(f"{key}.{name} is missing; {part.__qualname__} needs it")
        if name in settings and not _fits(settings[name], kind):
            problems.append(f"{key}.{name} is {settings[name]!r}; allowed: {_words(kind)}")
    return problems


def _parameters(part: Callable[..., Any]) -> tuple[dict[str, Parameter], bool]:
    """The arguments that a part takes by name, and whether it takes any others.

    A constructor that passes the rest on (``**settings``) takes those of its base class, too. It
    may give some of these itself, so that none of them is missed here.
    """
    found: dict[str, Parameter] = {}
    for level, signature in enumerate(_signatures(part)):
        for parameter in signature.parameters.values():
            if parameter.kind in _BY_NAME and parameter.name not in found:
                found[parameter.name] = parameter.replace(default=None) if level else parameter
        if all(each.kind is not Parameter.VAR_KEYWORD for each in signature.parameters.values()):
            return found, False
    return found, True


def _signatures(part: Callable[..., Any]) -> Iterator[inspect.Signature]:
    """Of a function its own; of a class its constructor's, then those of its bases."""
    for maker in part.__mro__[:-1] if isinstance(part, type) else (part,):
        try:
            yield inspect.signature(maker, eval_str=True)
        except (NameError, AttributeError):  # a type that is imported for type checkers alone
            yield inspect.signature(maker)
        except ValueError:  # compiled, and does not say
            return


def _fits(value: Any, kind: Any) -> bool:
    """Whether a setting can be of an annotated type; what this cannot tell, the part itself will.

    A part within is built by then, or a function that builds it.
    """
    origin = get_origin(kind) or kind
    if origin is Literal:
        return value in get_args(kind)
    if origin in (Union, UnionType):
        return any(_fits(value, part) for part in get_args(kind))
    if origin in (int, float) and isinstance(value, bool):
        return False
    if origin is float:
        return isinstance(value, int | float)
    return origin not in _WORDS or isinstance(value, NoneType if origin is None else origin)


def _words(kind: Any) -> str:
    origin = get_origin(kind) or kind
    if origin is Literal:
        return ", ".join(map(str, get_args(kind)))
    if origin in (Union, UnionType):
        return " or ".join(map(_words, get_args(kind)))
    return _WORDS.get(origin) or inspect.formatannotation(kind)
