"""Makes a run in MLflow the child of its sweep's run, by tags."""

from dataclasses import dataclass

from tlr_exp.mlflow_sync.names import PARENT_TAG, SWEEP_TAG
from tlr_exp.mlflow_sync.store import MlflowClient, MlflowException, Run


@dataclass(frozen=True)
class Parent:
    """A sweep: the id of its run in MLflow, and the name of its directory."""

    mlflow_run_id: str
    sweep: str


def link_tags(client: MlflowClient, run: Run, parent: Parent) -> dict[str, str]:
    """The tags that link `run` to `parent` and name all sweeps that it belongs to.

    MLflow knows one parent of a run. It stays the first, so that sweeps that share a run do not
    take it from each other, unless that was deleted.
    """
    sweeps = [name for name in run.data.tags.get(SWEEP_TAG, "").split(", ") if name]
    if parent.sweep not in sweeps:
        sweeps.append(parent.sweep)
    first = run.data.tags.get(PARENT_TAG)
    if first is None or (first != parent.mlflow_run_id and not _is_there(client, first)):
        first = parent.mlflow_run_id
    return {SWEEP_TAG: ", ".join(sweeps), PARENT_TAG: first}


def _is_there(client: MlflowClient, run_id: str) -> bool:
    """Whether the store has this run, not deleted."""
    try:
        return client.get_run(run_id).info.lifecycle_stage == "active"
    except MlflowException as error:
        if error.error_code != "RESOURCE_DOES_NOT_EXIST":
            raise
        return False
