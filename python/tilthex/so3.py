"""Rotations: the maps between rotation vectors and matrices, exact near 0 and pi."""

from tilthex._core import exp, hat, log, project, vee

__all__ = ["exp", "hat", "log", "project", "vee"]
