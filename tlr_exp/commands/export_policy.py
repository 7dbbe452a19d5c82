"""tlr-export-policy: a trained policy by itself, small enough to be kept with a project."""

import argparse
from importlib.util import find_spec
from pathlib import Path

from tlr_exp.commands.arguments import add_force
from tlr_exp.errors import UserError
from tlr_exp.machine.terminal import EXIT_WRONG, add_version, command, refuse_without_docstrings


@command("tlr-export-policy", status=EXIT_WRONG)
def main(arguments: list[str] | None = None) -> None:
    """The command line; the exit status is 0, or 2 for an error told in one line.

    The suffix of the output says which form is written.
    """
    refuse_without_docstrings("tlr-export-policy")
    options = _parser().parse_args(arguments)
    _export(options.run, options.checkpoint, options.output, options.force)


def _export(run: Path, checkpoint: str | None, output: Path, force: bool) -> None:
    """Write the form that the suffix of the output means.

    Raises:
        UserError, OSError: no such form; or as the form's own function.
    """
    if output.suffix not in ("", ".onnx"):
        raise UserError(
            f"{output}: a policy cannot be written with the suffix {output.suffix!r}; a name "
            "without a suffix makes a folder, one that ends in .onnx makes a single file"
        )
    write = _export_onnx if output.suffix == ".onnx" else _export_folder
    write(run, checkpoint, output, force)


def _export_onnx(run: Path, checkpoint: str | None, output: Path, force: bool) -> None:
    missing = [name for name in ("onnx", "onnxruntime") if find_spec(name) is None]
    if missing:
        raise UserError(f"{' and '.join(missing)} missing: pip install '.[onnx]' in the checkout")
    from tlr_exp.evaluation.choosing import choose
    from tlr_exp.export.onnx_file import write_onnx

    choice = choose(run, checkpoint)
    difference = write_onnx(choice, output, force)
    size = output.stat().st_size
    print(
        f"wrote {output}: {choice.run.name}, iteration {choice.iteration}, "
        f"{size / 1e6:.1f} MB; its actions match PyTorch's to {difference:.0e}"
    )


def _export_folder(run: Path, checkpoint: str | None, output: Path, force: bool) -> None:
    # After what can be checked at once: it loads PyTorch and MuJoCo, which takes seconds.
    from tlr_exp.export.folder import check_output, write_folder

    check_output(output, force)
    from tlr_exp.evaluation.choosing import choose

    choice = choose(run, checkpoint)
    write_folder(choice, output, force)
    size = sum(file.stat().st_size for file in output.rglob("*") if file.is_file())
    print(f"wrote {output}: {choice.run.name}, iteration {choice.iteration}, {size / 1e6:.1f} MB")
    print(f"watch it   tlr-evaluate {output} --web")


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="tlr-export-policy",
        description="Write the policy of a run as a folder of about 1 MB that tlr-evaluate accepts "
        "like the run itself, wherever it is: configuration, motion, the network with the "
        "normalisation of its input, and where it comes from. It names no people, machines or "
        "places, and cannot be trained further. Or write an ONNX file with the reference and "
        "everything else that a controller needs.",
    )
    add_version(parser)
    parser.add_argument("run", type=Path, metavar="RUN", help="run directory, or a checkpoint file")
    parser.add_argument(
        *("-o", "--output"),
        type=Path,
        required=True,
        metavar="PATH",
        help="the folder to write; or NAME.onnx, a single file for a controller (docs/deploy.md)",
    )
    parser.add_argument(
        "--checkpoint",
        metavar="best|last|ITERATION",
        help="which checkpoint (default: best, if there is one)",
    )
    add_force(parser, "an exported policy and the evaluations in its folder")
    return parser
