"""`light-meshes bench`: speed against error, in one run (method §6 and §7).

`scenes` are what is rendered, `measure` how a time is taken, `errors` how far a picture is off and from what, `runs`
the parts of a benchmark, `targets` what was hoped for, `decisions` what the plan saves, `tables` and `plots` the
output. Nothing here is imported by the renderer.
"""
