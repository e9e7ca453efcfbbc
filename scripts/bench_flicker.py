# SPDX-License-Identifier: GPL-3.0-or-later
"""The flicker cases as a benchmark: `./run bench flicker [--markdown]`."""

import sys

from case_table import main

sys.exit(main("flicker", "How steady animations are.", "flicker"))
