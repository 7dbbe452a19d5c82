"""``python -m tlr_exp.motion_tool`` is ``tlr-motion``."""

import sys

from tlr_exp.motion_tool import main

sys.exit(main())
