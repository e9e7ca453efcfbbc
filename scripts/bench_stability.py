# SPDX-License-Identifier: GPL-3.0-or-later
"""The stability cases as a benchmark: `./run bench stability [--markdown]`."""

import sys

from case_table import main

sys.exit(main("stability", "Where methods fail.", "cases"))
