"""A study as a folder of tables that can be published and read again without the runs.

runs.parquet, curves.parquet  the frames of analysis.data.study.Study, the index of runs as a column
starts.csv                    its roll-outs from many start phases, where there are any
manifest.json                 format, source, command, notes, and the SHA-256 of the tables

Numbers are kept as float64, as they were measured: an exported study gives the same statistics to
the last digit. Split into byte streams and compressed by zstd, ten runs of 407 iterations and 62
columns took 0.6 MB (float32: 0.5 MB).
"""

import hashlib
import io
import json
import os
import shutil
from collections.abc import Iterable, Mapping
from contextlib import suppress
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from analysis.data.starts import STARTS, csv_of_starts, of_runs, parse_starts, read_starts
from analysis.data.study import CURVE_KEYS, RUN, Remedy, Study, StudyError
from tlr_exp.records.directory import MANIFEST, TABLE_SUFFIX
from tlr_exp.records.provenance import package_versions
from tlr_exp.records.storage import json_bytes, write_through

RUNS, CURVES = f"runs{TABLE_SUFFIX}", f"curves{TABLE_SUFFIX}"
FILES = (RUNS, CURVES, MANIFEST)  # that every exported study has
FORMAT, VERSION = "tlr_exp study", 1
# Of a folder with an exported study of each of several motions.
MOTIONS, MOTIONS_FORMAT = "motions.json", "tlr_exp motions"


def write_tables(
    study: Study,
    folder: str | Path,
    source: Iterable[str] = (),
    command: str = "",
    force: bool = False,
) -> dict[str, Any]:
    """Write `study` to `folder` and return its manifest.

    `source` and `command` say where the runs came from. A new folder appears whole or not at all.
    With `force` the tables in a folder that is not empty are replaced; other files in it stay. A
    kill between these replacements leaves a folder that `from_tables` refuses.

    Raises:
        StudyError: the folder is not empty, and not `force`; or it cannot be written.
    """
    folder = Path(folder).resolve()
    occupied = is_occupied(folder, force)
    tables = {RUNS: _parquet(study.runs.reset_index()), CURVES: _parquet(study.curves)}
    if len(study.starts):
        tables[STARTS] = csv_of_starts(study.starts, study.runs)
    manifest = _manifest(study, tables, list(source), command)
    beside = folder.with_name(f".{folder.name}.{os.getpid()}.tmp")
    try:
        shutil.rmtree(beside, ignore_errors=True)
        beside.mkdir(parents=True)
        for name, data in {**tables, MANIFEST: json_bytes(manifest)}.items():
            write_through(beside / name, data)
        if occupied:
            for name in (*tables, MANIFEST):
                os.replace(beside / name, folder / name)
            if STARTS not in tables:  # those of an earlier export are of other runs
                (folder / STARTS).unlink(missing_ok=True)
        else:
            os.replace(beside, folder)
    except OSError as error:
        raise StudyError(f"cannot write {folder}: {error.strerror or error}") from error
    finally:
        with suppress(OSError):
            shutil.rmtree(beside)
    return manifest


def from_tables(folder: str | Path) -> Study:
    """The study that `write_tables` wrote.

    Raises:
        StudyError: a file is missing, damaged or not as the manifest says, was written by a newer
            version, or the tables are no study; names the file and what is wrong.
    """
    folder = Path(folder)
    manifest = read_manifest(folder)
    frames = {name: _frame(folder / name, manifest["sha256"]) for name in (RUNS, CURVES)}
    runs, curves = frames[RUNS], _with_floats(frames[CURVES])
    if RUN not in runs.columns:
        raise StudyError(f"{folder / RUNS}: the column {RUN} is missing")
    starts, said = _starts(folder, manifest["sha256"], runs[RUN].tolist())
    notes = [str(note) for note in manifest.get("notes") or []]
    notes += [note for note in said if note not in notes]
    baseline = str(manifest.get("baseline") or "")
    try:
        return Study(runs.set_index(RUN), curves, baseline, tuple(notes), starts)
    except StudyError as error:
        lines = str(error).splitlines()
        raise StudyError("\n".join(f"{folder}: {line}" for line in lines)) from error


def read_manifest(folder: Path) -> dict[str, Any]:
    """manifest.json of an exported study.

    Raises:
        StudyError: it is missing, damaged, of something else, or of a newer version.
    """
    path = folder / MANIFEST
    try:
        manifest = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        raise StudyError(f"{folder} is no exported study: there is no {path}") from None
    except (OSError, ValueError) as error:
        raise StudyError(f"{path}: cannot be read ({_short(error)})") from error
    if not isinstance(manifest, dict) or manifest.get("format") != FORMAT:
        raise StudyError(f'{path}: is not of an exported study (which has "format": "{FORMAT}")')
    version = manifest.get("format_version")
    if not isinstance(version, int):
        raise StudyError(f"{path}: format_version is {version!r}; it must be an integer")
    if version > VERSION:
        raise StudyError(
            f"{path}: written in format version {version}, this installation reads up to "
            f"{VERSION}: install a newer tlr_exp (it was written by {manifest.get('tlr_exp')})"
        )
    sums = manifest.get("sha256")
    if not isinstance(sums, dict) or not {RUNS, CURVES} <= sums.keys():
        raise StudyError(f"{path}: sha256 must name {RUNS} and {CURVES}")
    return manifest


def is_occupied(folder: Path, force: bool = False) -> bool:
    """Whether there is something in `folder`.

    Raises:
        StudyError: there is, and not `force`; or it is a file.
    """
    if folder.exists() and not folder.is_dir():
        raise StudyError(f"{folder} is a file; give the name of a folder")
    occupied = folder.is_dir() and any(folder.iterdir())
    if occupied and not force:
        raise StudyError(
            f"{folder} is not empty; choose another folder, or force it", Remedy.REPLACE
        )
    return occupied


def is_exported(folder: Path) -> bool:
    """Whether `folder` looks like an exported study rather than runs."""
    return any((folder / name).is_file() for name in (RUNS, CURVES))


def write_motions(folder: Path, motions: Mapping[str, str]) -> None:
    """Write down which folders within `folder` are the studies of which motions."""
    content = {"format": MOTIONS_FORMAT, "motions": dict(motions)}
    write_through(folder / MOTIONS, json_bytes(content))


def exported_in(folder: Path) -> list[Path]:
    """The exported studies, one a motion, of a folder that has some; else the folder itself.

    Raises:
        StudyError: the list of its motions is damaged.
    """
    path = folder / MOTIONS
    if not path.is_file():
        return [folder]
    try:
        motions = json.loads(path.read_text(encoding="utf-8"))["motions"]
        return [folder / name for name in motions.values()]
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise StudyError(f"{path}: cannot be read ({_short(error)})") from error


def _manifest(
    study: Study, tables: Mapping[str, bytes], source: list[str], command: str
) -> dict[str, Any]:
    return {
        "format": FORMAT,
        "format_version": VERSION,
        "tlr_exp": package_versions(("tlr_exp",)).get("tlr_exp", ""),
        "created_at": datetime.now(UTC).isoformat(timespec="seconds"),
        "source": source,
        "command": command,
        "arms": list(study.arms),
        "baseline": study.baseline,
        "runs": len(study.runs),
        "iterations": study.iterations,
        "metrics": len(study.metric_names),
        "roll_outs": len(study.starts),
        "notes": list(study.notes),
        "sha256": {name: hashlib.sha256(data).hexdigest() for name, data in tables.items()},
    }


def _parquet(frame: pd.DataFrame) -> bytes:
    """The bytes of a Parquet file; floats as byte streams, all other columns as dictionaries."""
    floats = [name for name in frame.columns if pd.api.types.is_float_dtype(frame[name])]
    encoding: dict[str, Any] = {
        "use_byte_stream_split": floats,
        "use_dictionary": [name for name in frame.columns if name not in floats],
    }
    table, buffer = pa.Table.from_pandas(frame, preserve_index=False), io.BytesIO()
    pq.write_table(table, buffer, compression="zstd", compression_level=9, **encoding)
    return buffer.getvalue()


def _checked_bytes(path: Path, sums: Mapping[str, str]) -> bytes:
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise StudyError(f"{path} is missing") from None
    except OSError as error:
        raise StudyError(f"{path}: {error.strerror}") from error
    if hashlib.sha256(data).hexdigest() != sums[path.name]:
        raise StudyError(
            f"{path}: is damaged or was changed, its SHA-256 is not the one in {MANIFEST}"
        )
    return data


def _frame(path: Path, sums: Mapping[str, str]) -> pd.DataFrame:
    data = _checked_bytes(path, sums)
    try:
        return pq.read_table(io.BytesIO(data)).to_pandas()
    except (pa.ArrowException, OSError, ValueError) as error:
        raise StudyError(f"{path}: is no Parquet table ({_short(error)})") from error


def _starts(
    folder: Path, sums: Mapping[str, str], runs: list[str]
) -> tuple[pd.DataFrame, tuple[str, ...]]:
    """The roll-outs of the study and notes on them; a CSV without a checksum is one put there."""
    path = folder / STARTS
    if STARTS in sums:
        return of_runs([parse_starts(_checked_bytes(path, sums), str(path))], runs)
    return of_runs([read_starts(path)] if path.is_file() else [], runs)


def _with_floats(curves: pd.DataFrame) -> pd.DataFrame:
    """Metrics as float64; tables made elsewhere may hold whole numbers, or less precision."""
    kinds = {
        name: "float64"
        for name in curves.columns
        if name not in CURVE_KEYS and pd.api.types.is_numeric_dtype(curves[name])
    }
    return curves.astype(kinds)


def _short(error: Exception) -> str:
    return " ".join(str(error).split())[:120]
