"""Sensitivities: the exact derivatives of a control step, propagated beside the motion."""
