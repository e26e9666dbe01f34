"""The speed and accuracy figures of the documentation.

``make bench`` measures them all and writes docs/benchmarks.md.
"""
