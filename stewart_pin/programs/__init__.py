"""Straight-line programs, and what runs them on arrays of states; nothing of robots in them.

``symbolic`` reads a CasADi function as a list of operations, a `program`, which NumPy can compute; ``passes`` make
it shorter; ``llvm`` writes it on vectors and compiles it; ``array_kernel`` and ``arrays`` call what came out.
`compile_function` goes the whole way.
"""
