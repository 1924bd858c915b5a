"""The verbs of `stewart_pin.mechanics` as straight-line programs for arrays of states.

The way from a chain to machine code, each file by its own: ``plan`` and ``graph`` write CasADi functions;
``instructions`` reads them as a ``program``; ``preparing`` makes it shorter; ``llvm_module`` writes it on vectors;
``machine_code`` compiles it; ``array_kernel`` and ``single_state`` call it. ``interpreter`` runs the program without a
compiler, and in long double judges the rest.
"""
