"""The verbs of `stewart_pin.mechanics` as straight-line programs for arrays of states.

The way from a chain to a program, each folder by its own: ``planning`` takes the chain apart and chooses the order of
elimination; ``graph`` writes CasADi functions, which `stewart_pin.programs` compiles; ``verbs`` are what `Kernels`
answers. ``choosing`` tells the rest of the package when kernels pay.
"""
