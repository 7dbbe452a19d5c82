"""``python -m tlr_exp.export_policy`` is ``tlr-export-policy``."""

import sys

from tlr_exp.export_policy import main

sys.exit(main())
