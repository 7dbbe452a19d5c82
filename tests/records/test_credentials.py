"""Passwords in tracking URIs: hidden wherever they stand, and given to MLflow another way."""

import pytest

from tlr_exp.records.credentials import (
    Credentials,
    has_credentials,
    hide_password,
    scrub,
    split_credentials,
)


@pytest.mark.parametrize(
    ("uri", "shown"),
    [
        ("http://host:5000", "http://host:5000"),
        ("https://me:s3cret@host:5000/mlflow", "https://host:5000/mlflow"),
        ("http://me:s3/cr@et@host", "http://host"),  # not escaped as it should be
        ("postgresql+psycopg2://me:s3cret@host/db", "postgresql+psycopg2://host/db"),
        (
            "postgresql://host/db?user=me&password=s3cret&x=1",
            "postgresql://host/db?user=me&password=***&x=1",
        ),
        ("sqlite:////home/me@work/mlflow.db", "sqlite:////home/me@work/mlflow.db"),
        ("runs", "runs"),
    ],
)
def test_what_is_shown_of_a_uri(uri, shown):
    assert hide_password(uri) == shown
    assert has_credentials(uri) == (uri != shown)
    assert "s3" not in scrub(f"cannot reach {uri}/api", uri)


def test_credentials_are_unescaped_for_whom_they_are_given_to():
    address, given = split_credentials("http://me%40home:a%2Fb%3A@host:5000/x")
    assert address == "http://host:5000/x"
    assert given == Credentials("me@home", "a/b:")
    assert split_credentials("http://host") == ("http://host", None)
    database = "postgresql://me:s3cret@host/db"  # takes them in no other way
    assert split_credentials(database) == (database, None)
