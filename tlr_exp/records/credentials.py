"""Passwords in tracking URIs: nothing that is printed, written or uploaded holds one."""

import re
from dataclasses import dataclass
from urllib.parse import unquote

_IN_QUERY = re.compile(r"(?i)\b(pass\w*|pwd|token|sslpassword)=([^&]+)")
HIDDEN = "***"


@dataclass(frozen=True)
class Credentials:
    """User name and password as they are, not as a URI writes them."""

    user: str
    password: str


def hide_password(uri: str) -> str:
    """``uri`` for messages and logs, without user name and password."""
    scheme, separator, rest = uri.partition("://")
    # The path of a database file can hold an @, and has neither.
    if not separator or scheme.startswith("sqlite"):
        return uri
    # The last one: whoever forgot to escape a slash in the password has it in what looks a path.
    rest = rest.rpartition("@")[2]
    hidden = _IN_QUERY.sub(lambda found: f"{found.group(1)}={HIDDEN}", rest)
    return f"{scheme}{separator}{hidden}"


def has_credentials(uri: str) -> bool:
    """True if part of it is to be hidden."""
    return hide_password(uri) != uri


def split_credentials(uri: str) -> tuple[str, Credentials | None]:
    """The URI of a server without its credentials, and those; None where it has none."""
    scheme, separator, rest = uri.partition("://")
    given, at, host = rest.rpartition("@")
    if not scheme.startswith("http") or not at:
        return uri, None
    user, _, password = given.partition(":")
    return f"{scheme}{separator}{host}", Credentials(unquote(user), unquote(password))


def scrub(text: str, uri: str) -> str:
    """``text`` without the credentials of ``uri``, whoever wrote it."""
    _, separator, rest = uri.partition("://")
    given, at, _ = rest.rpartition("@")
    secrets = {value for _, value in _IN_QUERY.findall(rest)}
    if separator and at and not uri.startswith("sqlite"):
        text = text.replace(f"{given}@", "")
        secrets.add(given.partition(":")[2])
    for secret in filter(None, secrets | {unquote(one) for one in secrets}):
        text = text.replace(secret, HIDDEN)
    return text
