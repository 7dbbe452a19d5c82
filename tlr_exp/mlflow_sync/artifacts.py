"""The files of a run or a sweep on their way into MLflow, each once however often it is tried."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from tlr_exp.mlflow_sync.names import FILES_TAG
from tlr_exp.mlflow_sync.store import MlflowClient, Run
from tlr_exp.records.storage import file_state


@dataclass(frozen=True)
class Artifact:
    """A file and the folder that it goes to in MLflow ("" for the topmost)."""

    path: Path
    folder: str = ""

    @property
    def name(self) -> str:
        return f"{self.folder}/{self.path.name}" if self.folder else self.path.name

    @property
    def state(self) -> object:
        """Differs once the file has changed."""
        return self.folder, self.path, file_state(self.path)


class ArtifactUpload:
    """The files of one folder on their way to one MLflow run.

    Records are small files that change in place: all go again when the content of one has changed.
    The others go when MLflow has none of that name and size.
    """

    def __init__(self) -> None:
        self._run_id = ""
        self._there: set[object] = set()  # states of files that MLflow has
        self._listed: set[str] = set()  # folders that were compared with MLflow's

    def push(
        self,
        client: MlflowClient,
        run: Run,
        records: Sequence[Artifact],
        others: Sequence[Artifact] = (),
    ) -> int:
        """Copy the files that the store lacks or has otherwise; the number of those."""
        if self._run_id != run.info.run_id:
            self._run_id, self._there, self._listed = run.info.run_id, set(), set()
        digest = _digest(records)
        if run.data.tags.get(FILES_TAG) == digest:
            self._there |= {record.state for record in records}
        self._compare(client, others)
        new = [file for file in (*records, *others) if file.state not in self._there]
        for file in new:
            state = file.state  # before the copy: a file that grows meanwhile is new again
            client.log_artifact(self._run_id, str(file.path), file.folder or None)
            self._there.add(state)
        if run.data.tags.get(FILES_TAG) != digest:
            client.set_tag(self._run_id, FILES_TAG, digest)
        return len(new)

    def _compare(self, client: MlflowClient, files: Sequence[Artifact]) -> None:
        """Note the files that an earlier process has brought over."""
        new = [file for file in files if file.state not in self._there]
        folders = {file.folder.partition("/")[0] for file in new} - self._listed
        sizes: dict[str, int] = {}
        for folder in folders:
            sizes |= _artifact_sizes(client, self._run_id, folder)
        self._listed |= folders
        self._there |= {
            file.state for file in new if sizes.get(file.name) == file.path.stat().st_size
        }


def files_below(root: Path, *folders: str) -> list[Artifact]:
    """The files below folders of `root`, hidden ones (half-written) apart, with their places."""
    return [
        Artifact(path, path.parent.relative_to(root).as_posix())
        for folder in folders
        for path in sorted((root / folder).rglob("*"))
        if path.is_file() and path.name[0] != "."
    ]


def _artifact_sizes(client: MlflowClient, run_id: str, folder: str) -> dict[str, int]:
    """Sizes in bytes of the artifacts below `folder`, by path."""
    sizes: dict[str, int] = {}
    for item in client.list_artifacts(run_id, folder):
        if item.is_dir:
            sizes |= _artifact_sizes(client, run_id, item.path)
        else:
            sizes[item.path] = item.file_size or 0
    return sizes


def _digest(records: Sequence[Artifact]) -> str:
    digest = hashlib.sha256()
    for record in records:
        content = record.path.read_bytes()
        digest.update(f"{record.name}\n{len(content)}\n".encode() + content)
    return digest.hexdigest()[:16]
