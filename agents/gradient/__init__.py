"""Analytic policy gradients: networks that begin as a law, trained through the exact physics."""
