"""Closed-chain (parallel-robot) dynamics on Pinocchio.

``import stewart_pin as stp`` gives the verbs; a robot with loops is a `ClosedChain`, read by `load`. What stands here
and in the namespaces by topic (`stp.hexapods`, `stp.polytopes`, ...) is listed in ``__init__.pyi``; a name is loaded
when it is first used.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)

__version__ = "0.1.0"
