"""``python -m tlr_exp.commands.evaluate`` is ``tlr-evaluate``."""

import sys

from tlr_exp.commands.evaluate import main

sys.exit(main())
