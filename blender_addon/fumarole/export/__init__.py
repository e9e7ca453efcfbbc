# SPDX-License-Identifier: GPL-3.0-or-later
"""From an evaluated render depsgraph to plain arrays, and from those to a core scene."""
