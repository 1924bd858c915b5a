"""The articulated-body algorithm as the textbook has it, for trees and for chains with loops.

Written to be read next to chapter 7 of [1]: bodies and joints come from the package's own description, spatial vectors
are his, [angular; linear], and no Pinocchio algorithm runs here, so that agreement with one is evidence.

References
----------
.. [1] R. Featherstone, "Rigid Body Dynamics Algorithms", Springer, 2008.
"""
