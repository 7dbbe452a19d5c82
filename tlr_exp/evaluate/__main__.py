"""``python -m tlr_exp.evaluate`` is ``tlr-evaluate``."""

import sys

from tlr_exp.evaluate import main

sys.exit(main())
