"""Inverse dynamics in maximal coordinates: every body has six, every joint takes some away.

An independent second computation: it shares no formula with the Pinocchio methods, calls neither RNEA nor the loop
Jacobian, and does its own kinematics. Spatial vectors are [linear; angular], in world axes, at the world origin.
"""
