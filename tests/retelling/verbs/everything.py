"""Every question, of all modules."""

from __future__ import annotations

from tests.retelling.verbs import chains, dynamics, forms, kernels, motions, singularities, states
from tests.retelling.verbs.asking import KINDS, QUESTIONS, VERBS, Answers, Sized, Verb

MODULES = (states, singularities, dynamics, motions, forms, kernels, chains)
__all__ = ["KINDS", "MODULES", "QUESTIONS", "VERBS", "Answers", "Sized", "Verb"]
