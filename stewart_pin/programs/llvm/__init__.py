"""Programs as LLVM modules on vectors, and as machine code."""
