"""Dry friction on a linear plant, every crossing found."""
