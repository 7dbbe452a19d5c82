"""The sweeper to which Hydra hands ``tlr-train -m`` over (conf/hydra/sweeper).

Hydra takes sweepers from the namespace ``hydra_plugins`` alone, and loads all of it at every start.
"""

import sys
import traceback
from collections.abc import Mapping, Sequence
from typing import Any

from hydra.plugins.sweeper import Sweeper
from hydra.types import HydraContext
from omegaconf import DictConfig


class TlrExpSweeper(Sweeper):
    """Has a sweep done by ``tlr_exp.sweeps``, and leaves with its exit status.

    Hydra's own sweeper would start finished jobs, too, tell of a failure by an exception after the
    last job, and know nothing of resuming.

    Args:
        params: what a preset sweeps over; read with the rest of the configuration.
    """

    def __init__(self, params: Mapping[str, str] | None = None) -> None:
        self.params = params

    def setup(self, *, hydra_context: HydraContext, task_function: Any, config: DictConfig) -> None:
        self._asked = (config, hydra_context)

    def sweep(self, arguments: Sequence[str]) -> None:
        # Not before: single runs are to start fast.
        from tlr_exp.sweeps.command import run_sweep

        try:
            status = run_sweep(*self._asked)
        except Exception:
            traceback.print_exc()  # Hydra would leave out most of it
            status = 1
        sys.exit(status)
