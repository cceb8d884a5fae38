"""What the exporters share: OpenEXR files, the lens in their header, merging of samples, frames.

Needs Python 3.11 and numpy. Nothing here knows a renderer.
"""

# The version of thinlens that the exporters belong to; written into headers.
VERSION = "0.2.0"
