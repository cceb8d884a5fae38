"""Depth peels of a Mitsuba 3 scene, as a stack for thinlens.

`cli` is the command line, `peel_integrator` the plug-in. Both need a variant to be set before they are imported.
"""
