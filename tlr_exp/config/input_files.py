"""The files that a configuration means, and hashes of what they hold: that is part of a run."""

import hashlib
from collections.abc import Iterator, Mapping
from importlib.resources import files
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

# The keys of a configuration that name files.
MOTION, MODEL, INITIAL = "env.motion", "env.robot.mjcf", "init_from"

MOTION_FILES = (".yaml", ".yml", ".npz")
# The attributes of MuJoCo's <compiler> that say where a model's other files lie.
_FOLDERS = ("assetdir", "meshdir", "texturedir")


def is_motion_path(motion: str) -> bool:
    """Whether ``env.motion`` is a path; else it is the name of an authored motion."""
    return Path(motion).suffix in MOTION_FILES


def motion_content(motion: str) -> bytes:
    """The file that ``env.motion`` means: the one at a path, or an authored motion's YAML.

    Raises:
        FileNotFoundError: there is no such file.
    """
    if is_motion_path(motion):
        return Path(motion).read_bytes()
    return files("tlr_exp.motion.clips").joinpath(f"{motion}.yaml").read_bytes()


def file_hashes(config: Mapping[str, Any]) -> dict[str, str]:
    """SHA-256, by key, of the files that a plain configuration means.

    ``env.motion`` always has one; ``env.robot.mjcf`` where the robot is a model of one's own;
    ``init_from`` where the policy begins as that of a checkpoint.

    Raises:
        FileNotFoundError: there is no such file.
    """
    env = config["env"]
    hashes = {MOTION: hashlib.sha256(motion_content(env["motion"])).hexdigest()}
    if env["robot"]["mjcf"] is not None:
        hashes[MODEL] = model_hash(Path(env["robot"]["mjcf"]))
    if config.get(INITIAL) is not None:
        hashes[INITIAL] = hashlib.sha256(Path(config[INITIAL]).read_bytes()).hexdigest()
    return hashes


def model_hash(path: Path) -> str:
    """SHA-256 of an MJCF file and of all files that it names; of a file alone, of its bytes.

    Raises:
        FileNotFoundError: there is no such file.
    """
    digest = hashlib.sha256(path.read_bytes())
    for name, file in sorted(_named_files(path).items()):
        digest.update(f"\0{name}\0".encode() + hashlib.sha256(file.read_bytes()).digest())
    return digest.hexdigest()


def _named_files(path: Path) -> dict[str, Path]:
    """The included models, meshes and textures of an MJCF file: where they lie, by their names.

    What is not there, or is no XML, is left out: MuJoCo tells of both when it reads the model.
    """
    elements = [element for root in _trees(path, path.parent) for element in root.iter()]
    compilers = [element for element in elements if element.tag == "compiler"]
    folders = [path.parent]
    folders += [path.parent / c.get(key, "") for c in compilers for key in _FOLDERS]
    names = {element.get("file") for element in elements} - {None, ""}
    places = {
        name: [folder / name for folder in folders if (folder / name).is_file()]
        for name in names
        if name
    }
    return {name: found[0] for name, found in places.items() if found}


def _trees(path: Path, main: Path) -> Iterator[ElementTree.Element]:
    """The roots of an MJCF file and of those that it includes, named relative to ``main``."""
    try:
        root = ElementTree.parse(path).getroot()
    except (ElementTree.ParseError, OSError):
        return
    yield root
    for element in root.iter("include"):
        yield from _trees(main / element.get("file", ""), main)
