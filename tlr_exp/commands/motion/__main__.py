"""``python -m tlr_exp.commands.motion`` is ``tlr-motion``."""

import sys

from tlr_exp.commands.motion import main

sys.exit(main())
