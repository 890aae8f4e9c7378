"""`light-meshes bench`: measure speed against error in one run (method §6 and §7).

`scenes` defines what is rendered, `measure` how times are taken, and `errors` how errors are computed and against which
references. `runs` has the parts of a benchmark, `targets` compares the results with the targets, and `decisions`
measures what the plan saves. `tables` and `plots` write the output. The renderer does not import any of these modules.
"""
