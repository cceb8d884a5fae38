# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel thinlens below a camera's depth of field: export, apply the lens, live re-lens.

It only shows properties and buttons; what they do is in `operators.py` and `live.py`.
"""
