"""Straight-line lists of operations: read from CasADi, made shorter, interpreted."""
