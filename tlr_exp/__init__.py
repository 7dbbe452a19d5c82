"""tlr_exp: experiment sweeps for two-layered reward learning on a humanoid."""

import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path

__version__ = "0.2.0"


def _take_the_conf_beside(root: Path) -> None:
    """In a checkout, let ``tlr_exp.conf`` be the checkout's own ``conf``.

    The folder lies outside this package, so Python would look for it where tlr_exp is installed: a
    second checkout on the path would silently read the YAML of the first.
    """
    folder = root / "conf"
    if not ((folder / "config.yaml").is_file() and (root / "pyproject.toml").is_file()):
        return  # installed without a checkout: tlr_exp.conf lies in the package
    name = f"{__name__}.conf"
    spec = spec_from_file_location(
        name, folder / "__init__.py", submodule_search_locations=[str(folder)]
    )
    assert spec is not None
    assert spec.loader is not None
    sys.modules[name] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules[name])


_take_the_conf_beside(Path(__file__).parents[1])
