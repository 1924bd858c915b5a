"""The verbs of `stewart_pin.mechanics` as straight-line programs for arrays of states.

The way from a chain to machine code, each folder by its own: ``planning`` takes the chain apart and chooses the order
of elimination; ``graph`` writes CasADi functions; ``programs`` reads them as lists of operations, makes these shorter,
and can interpret them, in long double too; ``llvm`` writes them on vectors and compiles them; ``running`` calls them
with arrays; ``verbs`` are what `Kernels` answers. ``choosing`` tells the rest of the package when kernels pay.
"""
