# SPDX-License-Identifier: GPL-3.0-or-later
"""thinlens in Blender: depth of field after the render."""
